/** One input for each kind of value: number, choice, flags, switch, text, bytes, vector. Invalid input is reported while typing. */
import { useEffect, useState } from "preact/hooks";
import { Select } from "../ui/controls/choices";
import { labelWords as named } from "../ui/format/labels";
import { idOf, type FormContext } from "./form-context";
import type { FieldForm } from "../wire/form-types";
import {
  at,
  big,
  bitsOf,
  isReserved,
  offered,
  type Path,
  read,
  type ReadInput,
  small,
  textProblem,
  typed,
  withBits,
} from "./values";
import { TEXT } from "../texts/forms";

export interface InputProps {
  readonly sheet: FormContext;
  readonly field: FieldForm;
  readonly path: Path;
  /** For a screen reader, if no visible label belongs to this control alone. */
  readonly label?: string | undefined;
  readonly describedBy?: string | undefined;
}

const locked = (sheet: FormContext, field: FieldForm): boolean => sheet.readOnly || field.read_only;
const labelled = (label: string | undefined) => (label === undefined ? {} : { "aria-label": label });

/** A text that becomes a value when valid; invalid text is kept and reported. */
function useTyped(props: InputProps, shown: string, take: (text: string) => ReadInput) {
  const { sheet, path } = props;
  const [entry, setEntry] = useState<{
    readonly text: string;
    readonly why: string | undefined;
    readonly epoch: number;
  }>();
  const { text = undefined, why = undefined } = entry?.epoch === sheet.epoch ? entry : {}; // a discard leaves nothing of it
  // biome-ignore lint/correctness/useExhaustiveDependencies: the row and its sheet are those of the mount; another row has another key
  useEffect(() => () => sheet.wrong(path, undefined), [sheet.epoch]);
  const onInput = (event: { currentTarget: HTMLInputElement | HTMLTextAreaElement }): void => {
    const now = event.currentTarget.value;
    const reading = take(now);
    const problem = "problem" in reading ? reading.problem : undefined;
    setEntry({ text: now, why: problem, epoch: sheet.epoch });
    sheet.wrong(path, problem);
    if ("value" in reading) sheet.set(path, reading.value);
  };
  const onBlur = (): void => {
    if (why === undefined) setEntry(undefined);
  };
  return { value: text ?? shown, why, onInput, onBlur };
}

function Why({ id, why }: { readonly id: string; readonly why: string | undefined }) {
  return why === undefined ? null : (
    <span class="why-not" id={id} role="alert">
      {why}
    </span>
  );
}

export function NumberInput(props: InputProps) {
  const { sheet, field, path, label, describedBy } = props;
  const value = at(sheet.values, path);
  const { why, ...typing } = useTyped(props, typed(field, value), (text) => read(field, text));
  const id = idOf(sheet, path);
  const unit = field.unit.includes(",")
    ? (field.unit.split(",")[Number(path.at(-1))]?.trim() ?? field.unit)
    : field.unit;
  return (
    <span class="input-wrap">
      <span class={`field num ${why ? "bad" : ""}`}>
        <input
          id={id}
          type="text"
          inputMode={field.step === 1 && field.scale === 1 && (field.low ?? -1) >= 0 ? "numeric" : "text"}
          autocomplete="off"
          spellcheck={false}
          readOnly={locked(sheet, field)}
          aria-invalid={why !== undefined}
          aria-describedby={[describedBy, why && `${id}-why`].filter(Boolean).join(" ") || undefined}
          placeholder={value === undefined ? TEXT.notRead : ""}
          {...labelled(label)}
          {...typing}
        />
        {unit !== "" && <span class="unit">{unit}</span>}
      </span>
      <Why id={`${id}-why`} why={why} />
    </span>
  );
}

export function ChoiceInput({ sheet, field, path, label, describedBy }: InputProps) {
  const value = at(sheet.values, path);
  const shown = value === undefined ? "" : String(value);
  const isKnown = value === undefined || shown in field.choices;
  const unknown = isKnown ? [] : [[shown, TEXT.undocumentedValue(shown)] as const];
  return (
    <Select
      id={idOf(sheet, path)}
      label={label}
      describedBy={describedBy}
      value={shown}
      none={TEXT.notRead}
      options={[...unknown, ...inOrder(offered(field.choices, value))]}
      disabled={locked(sheet, field)}
      onChoose={(number) => sheet.set(path, small(big(number)))}
    />
  );
}

/** One text of several. */
export function OptionInput({
  sheet,
  field,
  path,
  label,
  describedBy,
  options,
}: InputProps & { readonly options: readonly string[] }) {
  const value = at(sheet.values, path);
  const now = typeof value === "string" ? value : "";
  const unknown = now === "" || options.includes(now) ? [] : [[now, now] as const];
  return (
    <Select
      id={idOf(sheet, path)}
      label={label}
      describedBy={describedBy}
      value={now}
      none={options.includes("") ? undefined : TEXT.notRead}
      options={[...unknown, ...options.map((option) => [option, option.replaceAll("/", " / ")] as const)]}
      disabled={locked(sheet, field)}
      onChoose={(option) => sheet.set(path, option)}
    />
  );
}

/** Choices in the order of their rates if they are rates; others in table order (a JSON object sorts small numbers first). */
function inOrder(choices: Readonly<Record<string, string>>): readonly (readonly [string, string])[] {
  const amount = (words: string): number => Number(/^([\d\s\u2009]+)Bd$/.exec(words)?.[1]?.replace(/\D/g, "") ?? NaN);
  const all = Object.entries(choices);
  const isRates = all.filter(([, words]) => Number.isFinite(amount(words))).length > all.length / 2;
  return isRates ? all.sort((a, b) => (amount(a[1]) || Infinity) - (amount(b[1]) || Infinity)) : all;
}

export function BoolInput({ sheet, field, path, label, describedBy }: InputProps) {
  return (
    <span class="segmented" role="group" aria-label={label ?? field.title} aria-describedby={describedBy}>
      {[0, 1].map((wire) => (
        <button
          type="button"
          key={wire}
          aria-pressed={Number(at(sheet.values, path) ?? -1) === wire}
          disabled={locked(sheet, field)}
          onClick={() => sheet.set(path, wire)}
        >
          {wire ? TEXT.on : TEXT.off}
        </button>
      ))}
    </span>
  );
}

/** A word of flags and bit groups, each by name, with the word in hex beside them. */
export function FlagsInput({ sheet, field, path, describedBy }: InputProps) {
  const word = big(at(sheet.values, path) ?? 0);
  const off = locked(sheet, field);
  return (
    <div class="flags" role="group" aria-label={field.title} aria-describedby={describedBy}>
      {field.bits
        .filter((bits) => !isReserved(bits) || bitsOf(word, bits) !== 0n)
        .map((bits) => {
          const part = bitsOf(word, bits);
          const set = (to: bigint): void => sheet.set(path, small(withBits(word, bits, to)));
          const id = `${idOf(sheet, path)}-${bits.low}-${bits.width}`;
          const title = bits.doc && !/^[A-Z0-9_]+$/.test(bits.doc) ? bits.doc : bits.name;
          return bits.width === 1 ? (
            <label class="flag" key={id} title={title}>
              <input
                type="checkbox"
                class="check"
                id={id}
                checked={part === 1n}
                disabled={off}
                onChange={(event) => set(event.currentTarget.checked ? 1n : 0n)}
              />
              <span>{named(bits.name)}</span>
            </label>
          ) : (
            <label class="flag group" key={id} title={title}>
              <span>{named(bits.name)}</span>
              <BitGroup id={id} bits={bits} part={part} off={off} set={set} />
            </label>
          );
        })}
      <span class="word mono dim">0x{word.toString(16).toUpperCase().padStart(2, "0")}</span>
    </div>
  );
}

interface GroupProps {
  readonly id: string;
  readonly bits: FieldForm["bits"][number];
  readonly part: bigint;
  readonly off: boolean;
  readonly set: (to: bigint) => void;
}

function BitGroup({ id, bits, part, off, set }: GroupProps) {
  const most = (1n << BigInt(bits.width)) - 1n;
  if (Object.keys(bits.choices).length === 0) {
    return (
      <span class="field num">
        <input
          id={id}
          type="number"
          min="0"
          max={String(most)}
          value={String(part)}
          readOnly={off}
          onInput={(event) => {
            const typedNow = big(event.currentTarget.value);
            if (event.currentTarget.value !== "" && typedNow >= 0n && typedNow <= most) set(typedNow);
          }}
        />
      </span>
    );
  }
  const unknown = String(part) in bits.choices ? [] : [[String(part), String(part)] as const];
  return (
    <Select
      id={id}
      value={String(part)}
      options={[...unknown, ...inOrder(offered(bits.choices, part))]}
      disabled={off}
      onChoose={(number) => set(big(number))}
    />
  );
}

export function TextInput(props: InputProps) {
  const { sheet, field, path, label, describedBy } = props;
  const isHex = field.editor === "hex";
  const value = at(sheet.values, path);
  const take = (text: string): ReadInput => {
    const problem = textProblem(field, text);
    return problem === undefined ? { value: isHex ? text.replace(/\s/g, "").toLowerCase() : text } : { problem };
  };
  const { why, ...typing } = useTyped(props, typeof value === "string" ? value : "", take);
  const id = idOf(sheet, path);
  const most = field.length || field.max_length;
  const common = {
    id,
    spellcheck: false,
    autocomplete: "off" as const,
    autocapitalize: "off" as const,
    readOnly: locked(sheet, field),
    "aria-invalid": why !== undefined,
    "aria-describedby": [describedBy, why && `${id}-why`].filter(Boolean).join(" ") || undefined,
    ...labelled(label),
    ...typing,
  };
  return (
    <span class="input-wrap wide">
      <span class={`field ${why ? "bad" : ""} ${isHex && most !== 1 && (most === 0 || most > 16) ? "tall" : ""}`}>
        {isHex && (most === 0 || most > 16) ? (
          <textarea class="mono" rows={3} placeholder="00 11 22 …" {...common} />
        ) : (
          <input type="text" class={isHex ? "mono" : ""} {...common} />
        )}
      </span>
      <Why id={`${id}-why`} why={why} />
    </span>
  );
}

/** A longer vector is edited as one text of numbers. */
const MAX_INPUTS = 16;

export function VectorInput(props: InputProps) {
  const { sheet, field, path } = props;
  const values = at(sheet.values, path);
  const count = field.length || (Array.isArray(values) ? values.length : 0);
  if (count > MAX_INPUTS) return <NumbersInput {...props} />;
  return (
    <span class="vector">
      {Array.from({ length: count }, (_, place) => {
        const axis = field.axes[place] ?? `${place + 1}`;
        return (
          <label key={place}>
            <span class="axis">{axis}</span>
            <NumberInput
              sheet={startedOf(sheet, field, path, count)}
              field={field}
              path={[...path, place]}
              label={`${field.title}, ${axis}`}
            />
          </label>
        );
      })}
    </span>
  );
}

/** Context for a vector that was never read: it starts with zeros. */
function startedOf(sheet: FormContext, field: FieldForm, path: Path, count: number): FormContext {
  if (Array.isArray(at(sheet.values, path))) return sheet;
  const set = (inner: Path, value: unknown): void => {
    const zeros: number[] = Array.from({ length: count }, () => Math.max(0, field.low ?? 0));
    sheet.set(
      path,
      zeros.map((zero, place) => (place === inner.at(-1) ? value : zero)),
    );
  };
  return { ...sheet, set };
}

/** Many numbers as one text, separated by commas or spaces. */
function NumbersInput(props: InputProps) {
  const { sheet, field, path, label } = props;
  const values = at(sheet.values, path);
  const shown = Array.isArray(values) ? values.map((one) => typed(field, one)).join(", ") : "";
  const { why, ...typing } = useTyped(props, shown, (text) => readNumbers(field, text));
  const id = idOf(sheet, path);
  return (
    <span class="input-wrap wide">
      <span class={`field tall ${why ? "bad" : ""}`}>
        <textarea
          id={id}
          class="mono"
          rows={3}
          spellcheck={false}
          readOnly={locked(sheet, field)}
          aria-invalid={why !== undefined}
          aria-label={label ?? TEXT.numbersOfField(field.title, field.length)}
          {...typing}
        />
      </span>
      <Why id={`${id}-why`} why={why} />
    </span>
  );
}

function readNumbers(field: FieldForm, text: string): ReadInput {
  const parts = text.split(/[\s,;]+/).filter(Boolean);
  const readings = parts.map((part) => read(field, part));
  const bad = readings.findIndex((reading) => "problem" in reading);
  if (bad >= 0) return { problem: TEXT.problemOfNumber(bad + 1, (readings[bad] as { problem: string }).problem) };
  if (field.length > 0 && parts.length !== field.length)
    return { problem: TEXT.wrongNumberCount(field.length, parts.length) };
  return { value: readings.map((reading) => ("value" in reading ? reading.value : 0)) };
}
