/** Choices over a plot beside the stack, such as a histogram. */
import type { ComponentChildren } from "preact";
import { hasCursors, type ViewState } from "../data/view-state";
import { COMMON } from "../texts/common";
import { type ChoiceOption, Select } from "../ui/controls/choices";
import "./tools.css";

export function ChartTools({ children }: { readonly children: ComponentChildren }) {
  return <div class="chart-tools flex-row">{children}</div>;
}

interface PairProps {
  readonly label: string;
  readonly names: readonly [string, string];
  readonly second: boolean;
  readonly onChange: (second: boolean) => void;
}

export function Pair({ label, names, second, onChange }: PairProps) {
  return (
    <div class="segmented small" role="group" aria-label={label} title={label}>
      {names.map((name, k) => (
        <button type="button" key={name} aria-pressed={second === (k === 1)} onClick={() => onChange(k === 1)}>
          {name}
        </button>
      ))}
    </div>
  );
}

interface RangeProps {
  readonly viewState: ViewState;
  readonly range: "cursors" | undefined;
  readonly onChange: (range: "cursors" | undefined) => void;
}

/** The window, or what is between both cursors; nothing to choose without them. */
export function RangeChoice({ viewState, range, onChange }: RangeProps) {
  if (!hasCursors(viewState)) return null;
  return (
    <Pair
      label={COMMON.range}
      names={[COMMON.window, COMMON.fromAToB]}
      second={range === "cursors"}
      onChange={(second) => onChange(second ? "cursors" : undefined)}
    />
  );
}

interface ChartSelectProps {
  readonly label: string;
  readonly value: string;
  readonly options: readonly ChoiceOption[];
  readonly onChange: (value: string) => void;
}

export function ChartSelect({ label, value, options, onChange }: ChartSelectProps) {
  return (
    <label class="chart-choice flex-row mid text-sm">
      <span aria-hidden="true">{label}</span>
      <Select label={label} value={value} options={options} onChoose={onChange} />
    </label>
  );
}
