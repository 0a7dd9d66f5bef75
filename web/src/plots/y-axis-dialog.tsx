/** The form for the y axis of a plot: a fixed range, a logarithmic axis, or automatic again. */
import { useSignal } from "@preact/signals";
import type { ViewState } from "../data/view-state";
import { Button } from "../ui/controls/button";
import { Dialog } from "../ui/controls/dialog";
import type { PlotSpec } from "../data/view";
import { typedRange } from "./y-axis";
import { setYAxis } from "./y-gutter";
import { TEXT } from "../texts/plots";

export function YAxisDialog({ viewState }: { readonly viewState: ViewState }) {
  const form = viewState.yAxisForm.value;
  const spec = viewState.actions
    .plots()
    .flatMap(axesOf)
    .find(({ key }) => key === form?.key);
  if (form === undefined || spec === undefined) return null;
  return <Form key={form.key} viewState={viewState} plot={spec} range={form.range} />;
}

/** The left axis of a plot, and that of its second unit. */
function axesOf({ key, title, unit, right }: PlotSpec): readonly Props["plot"][] {
  const own = { key, title, unit };
  return right ? [own, { key: right.key, title: TEXT.rightOf(title), unit: right.unit }] : [own];
}

interface Props {
  readonly viewState: ViewState;
  readonly plot: { readonly key: string; readonly title: string; readonly unit: string };
  readonly range: readonly [number, number];
}

function Form({ viewState, plot, range }: Props) {
  const chosen = viewState.yAxes.peek().get(plot.key);
  const typed = (value: number): string => String(Number(value.toPrecision(5)));
  const low = useSignal(typed(range[0]));
  const high = useSignal(typed(range[1]));
  const isLog = useSignal(chosen?.isLog === true);
  const problem = useSignal("");
  const close = (): void => void (viewState.yAxisForm.value = undefined);
  const apply = (): void => {
    const found = typedRange(low.value, high.value);
    if (found === "number") problem.value = TEXT.notANumber;
    else if (found === "order") problem.value = TEXT.wrongOrder(low.value, high.value);
    else if (isLog.value && found[0] <= 0) problem.value = TEXT.logNeedsPositive(low.value);
    else {
      setYAxis(viewState, plot.key, { range: found, ...(isLog.value ? { isLog: true } : {}) });
      close();
    }
  };
  const automatic = (): void => {
    setYAxis(viewState, plot.key, isLog.value ? { isLog: true } : {});
    close();
  };
  const fields = [
    { label: TEXT.maximum, value: high },
    { label: TEXT.minimum, value: low },
  ];
  return (
    <Dialog title={TEXT.yAxisOf(plot.title)} onClose={close}>
      <form
        class="y-axis-form"
        onSubmit={(event) => {
          event.preventDefault();
          apply();
        }}
      >
        {fields.map(({ label, value }) => (
          <label key={label}>
            <span>{label}</span>
            <span class="field">
              <input
                type="text"
                inputMode="text"
                value={value.value}
                autocomplete="off"
                onInput={(event) => (value.value = event.currentTarget.value)}
              />
              <span class="unit">{plot.unit}</span>
            </span>
          </label>
        ))}
        <label class="y-axis-log flex-row">
          <input
            type="checkbox"
            checked={isLog.value}
            onChange={(event) => (isLog.value = event.currentTarget.checked)}
          />{" "}
          {TEXT.logarithmicAxis}
        </label>
        <p class="dim">{TEXT.logHint}</p>
        {problem.value !== "" && <p role="alert">{problem.value}</p>}
        <div class="y-axis-buttons">
          <Button look="edge" words={TEXT.automatic} onClick={automatic} />
          <Button type="submit" look="main" words={TEXT.fix} />
        </div>
      </form>
    </Dialog>
  );
}
