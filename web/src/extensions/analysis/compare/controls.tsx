/** What is compared, and how both are aligned. */
import { useSignal } from "@preact/signals";
import { Button } from "../../../ui/controls/button";
import { Select } from "../../../ui/controls/choices";
import { IconButton } from "../../../ui/controls/icon-button";
import { Icon } from "../../../ui/controls/icons";
import { usePhone } from "../../../ui/controls/use-phone";
import { figure } from "../../../charts/axes";
import { boundsOf, type CompareModel, type Ready, isLive, momentsOf, comparedNames, sourceTitle } from "./model";
import type { SideChoice } from "./sides";
import { listName } from "../../../wire/device-name";
import { TEXT } from "./texts";

const LENGTHS = [10, 30, 60, 300];

interface Props {
  readonly model: CompareModel;
  readonly wanted: Ready;
  readonly correlate: () => void;
}

export function Controls({ model, wanted, correlate }: Props) {
  const isPhone = usePhone();
  // there the first chart comes before what is chosen once
  const isOpen = useSignal(false);
  const names = [wanted.a, wanted.b].map(({ source }) => sourceTitle(model.app, model.recordings.value, source));
  return (
    <>
      {isPhone && (
        <Button look="edge compare-fold" aria-expanded={isOpen.value} onClick={() => (isOpen.value = !isOpen.value)}>
          <span class="ellipsis">{TEXT.sidesOf(names[0] ?? "", names[1] ?? "", wanted.signal)}</span>
          <Icon name="down" />
        </Button>
      )}
      {(!isPhone || isOpen.value) && <Choices model={model} wanted={wanted} correlate={correlate} />}
    </>
  );
}

function Choices({ model, wanted, correlate }: Props) {
  const { place } = model;
  const change = (next: Partial<Ready>): void => {
    model.aligned.value = undefined;
    const { offset: _, ...rest } = { ...wanted, ...next };
    place.value = rest; // other sides have another offset
  };
  const swap = (): void => change({ a: wanted.b, b: wanted.a });
  return (
    <>
      <div class="compare-sides">
        <SidePicker model={model} name="A" title={TEXT.sideA} side={wanted.a} choose={(a) => change({ a })} />
        <IconButton icon="loop" label={TEXT.swap} class="edge" onClick={swap} />
        <SidePicker model={model} name="B" title={TEXT.sideB} side={wanted.b} choose={(b) => change({ b })} />
      </div>
      <div class="compare-sides">
        <SignalField model={model} wanted={wanted} />
        <Alignment model={model} wanted={wanted} correlate={correlate} />
      </div>
    </>
  );
}

interface PickerProps {
  readonly model: CompareModel;
  readonly name: "A" | "B";
  readonly title: string;
  readonly side: SideChoice;
  readonly choose: (side: SideChoice) => void;
}

function SidePicker({ model, name, title, side, choose }: PickerProps) {
  const { app, recordings, details } = model;
  const known = (recordings.value ?? []).filter(({ deleted, recording }) => deleted === null && !recording);
  const live = isLive(app, side.source);
  const devices = details.value.get(side.source)?.devices ?? [];
  const take = (source: string): void =>
    choose(isLive(app, source) ? { source, device: "", last: side.last ?? 30 } : { source, device: "" });
  const isListed = live || known.some(({ id }) => id === side.source);
  return (
    <div class="compare-side flex-wrap" role="group" aria-label={title}>
      <b class={name === "A" ? "side-a" : "side-b"}>{name}</b>
      <label class="select">
        <select
          aria-label={TEXT.source(name)}
          value={side.source}
          onChange={(event) => take(event.currentTarget.value)}
        >
          {!isListed && <option value={side.source}>{sourceTitle(app, recordings.value, side.source)}</option>}
          <optgroup label={TEXT.live}>
            {app.store.devices.value.map((device) => (
              <option key={device.id} value={device.id}>
                {listName(device)}
              </option>
            ))}
          </optgroup>
          <optgroup label={TEXT.recordings}>
            {known.map((info) => (
              <option key={info.id} value={info.id}>
                {sourceTitle(app, known, info.id)}
              </option>
            ))}
          </optgroup>
        </select>
        <Icon name="down" />
      </label>
      {devices.length > 1 && (
        <Select
          label={TEXT.device(name)}
          value={side.device}
          options={devices.map((device) => [device.id, listName(device)])}
          onChoose={(device) => choose({ ...side, device })}
        />
      )}
      {live ? <Length name={name} side={side} choose={choose} /> : <Range model={model} {...{ name, side, choose }} />}
    </div>
  );
}

function Length({ name, side, choose }: Omit<PickerProps, "model" | "title">) {
  const all = side.last === undefined || LENGTHS.includes(side.last) ? LENGTHS : [...LENGTHS, side.last];
  return (
    <Select
      label={TEXT.last(name)}
      value={side.last ?? ""}
      none={TEXT.stretch}
      options={[...all].sort((x, y) => x - y).map((seconds) => [seconds, TEXT.lastSeconds(seconds)])}
      onChoose={(last) => choose({ source: side.source, device: side.device, last })}
    />
  );
}

/** Range of a recording, s after its beginning. */
function Range({ model, name, side, choose }: Omit<PickerProps, "title">) {
  const [first] = boundsOf(model, side);
  const shown = (time: number | undefined): string =>
    time === undefined ? "" : String(Number((time - first).toFixed(3)));
  const take = (end: "begin" | "end", text: string): void => {
    const { [end]: _, ...rest } = side;
    const seconds = Number(text);
    choose(text.trim() === "" || !Number.isFinite(seconds) ? rest : { ...rest, [end]: first + seconds });
  };
  return (
    <>
      {(["begin", "end"] as const).map((end) => (
        <span class="field" key={end}>
          <input
            type="number"
            step="any"
            aria-label={end === "begin" ? TEXT.from(name) : TEXT.to(name)}
            title={end === "begin" ? TEXT.from(name) : TEXT.to(name)}
            placeholder={end === "begin" ? TEXT.beginning : TEXT.end}
            value={shown(side[end])}
            onChange={(event) => take(end, event.currentTarget.value)}
          />
        </span>
      ))}
    </>
  );
}

function SignalField({ model, wanted }: Omit<Props, "correlate">) {
  const { app, details, place } = model;
  const own = comparedNames(app, details.value, wanted.a);
  const others = comparedNames(app, details.value, wanted.b);
  const differs = wanted.signalB !== "" || !others.includes(wanted.signal);
  return (
    <>
      <Field
        label={TEXT.signal}
        id="compare-signals"
        names={own}
        value={wanted.signal}
        set={(signal) => (place.value = { ...wanted, signal, signalB: "" })}
      />
      {differs && (
        <Field
          label={TEXT.signalB}
          id="compare-signals-b"
          names={others}
          value={wanted.signalB || wanted.signal}
          set={(signalB) => (place.value = { ...wanted, signalB: signalB === wanted.signal ? "" : signalB })}
        />
      )}
    </>
  );
}

interface FieldProps {
  readonly label: string;
  readonly id: string;
  readonly names: readonly string[];
  readonly value: string;
  readonly set: (value: string) => void;
}

function Field({ label, id, names, value, set }: FieldProps) {
  return (
    <label class="labelled compare-signal">
      <span>{label}</span>
      <span class="field">
        <input
          type="text"
          list={id}
          value={value}
          spellcheck={false}
          autocomplete="off"
          onChange={(event) => set(event.currentTarget.value.trim())}
        />
      </span>
      <datalist id={id}>
        {names.map((one) => (
          <option key={one} value={one} />
        ))}
      </datalist>
    </label>
  );
}

function Alignment({ model, wanted, correlate }: Props) {
  const { place, shown, correlating, aligned } = model;
  const isEvents = useSignal(false);
  const offset = wanted.offset ?? shown.value.answer?.offset ?? 0;
  const set = (next: number | undefined): void => {
    aligned.value = undefined;
    const { offset: _, ...rest } = wanted;
    place.value = next === undefined ? rest : { ...wanted, offset: next };
  };
  const start = (): void => {
    const [a, b] = [wanted.a, wanted.b].map((side) => side.begin ?? boundsOf(model, side)[0]);
    set((a ?? 0) - (b ?? 0));
  };
  return (
    <>
      <div class="segmented" role="group" aria-label={TEXT.alignment}>
        <button type="button" aria-pressed={offset === 0} onClick={() => set(0)}>
          {TEXT.byClock}
        </button>
        <button type="button" onClick={start}>
          {TEXT.byStart}
        </button>
        <button
          type="button"
          aria-pressed={isEvents.value}
          aria-expanded={isEvents.value}
          onClick={() => (isEvents.value = !isEvents.value)}
        >
          {TEXT.byEvents}
        </button>
      </div>
      <Button
        look="main"
        icon="wand"
        words={correlating.value ? TEXT.correlating : TEXT.byCorrelation}
        disabled={correlating.value}
        onClick={correlate}
      />
      <label class="labelled compare-offset" title={TEXT.offsetHint}>
        <span>{TEXT.offset} (s)</span>
        <span class="field">
          <input
            type="number"
            step="0.001"
            value={Number((offset + model.dragged.value).toFixed(6))}
            onChange={(event) => set(Number(event.currentTarget.value) || 0)}
          />
        </span>
      </label>
      {isEvents.value && <Events model={model} wanted={wanted} set={set} />}
    </>
  );
}

function Events({ model, wanted, set }: Omit<Props, "correlate"> & { readonly set: (offset: number) => void }) {
  const chosen = { A: useSignal(""), B: useSignal("") };
  const sides = { A: wanted.a, B: wanted.b };
  const apply = (): void => {
    const { A, B } = chosen;
    if (A.value !== "" && B.value !== "") set(Number(A.value) - Number(B.value));
  };
  return (
    <>
      {(["A", "B"] as const).map((name) => {
        const [first] = boundsOf(model, sides[name]);
        return (
          <Select
            key={name}
            label={TEXT.eventOf(name)}
            value={chosen[name].value}
            options={[
              ["", `${name}: ${TEXT.choose}`],
              ...momentsOf(model, sides[name]).map(
                ({ time, text }) => [String(time), `${figure(time - first)} s: ${text}`] as const,
              ),
            ]}
            onChoose={(time) => {
              chosen[name].value = time;
              apply();
            }}
          />
        );
      })}
    </>
  );
}
