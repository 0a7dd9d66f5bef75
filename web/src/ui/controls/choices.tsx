/** Controls that choose one of several: a list of the browser's own, and buttons side by side. */
import { Icon } from "./icons";

/** A value to choose, and its text. */
export type ChoiceOption<T extends string | number = string> = readonly [value: T, text: string | undefined];

interface ChoiceProps<T extends string | number> {
  readonly options: readonly ChoiceOption<T>[];
  readonly onChoose: (value: T) => void;
}

interface OptionListProps<T extends string | number> extends ChoiceProps<T> {
  /** Read aloud; absent where a `label` says it. */
  readonly label?: string | undefined;
  readonly id?: string;
  readonly describedBy?: string | undefined;
  readonly value: NoInfer<T> | "";
  /** Text while nothing is chosen. */
  readonly none?: string | undefined;
  readonly disabled?: boolean;
}

export function OptionList<T extends string | number>(props: OptionListProps<T>) {
  const { label, id, describedBy, value, options, none, disabled, onChoose } = props;
  const choose = (text: string): void => {
    const found = options.find(([one]) => String(one) === text);
    if (found) onChoose(found[0]);
  };
  return (
    <select
      id={id}
      aria-label={label}
      aria-describedby={describedBy}
      value={String(value)}
      disabled={disabled}
      onChange={(event) => choose(event.currentTarget.value)}
    >
      {value === "" && none !== undefined && <option value="">{none}</option>}
      {options.map(([one, text]) => (
        <option key={one} value={String(one)}>
          {text}
        </option>
      ))}
    </select>
  );
}

interface SelectProps<T extends string | number> extends OptionListProps<T> {
  /** Further classes of its frame. */
  readonly class?: string;
  readonly title?: string;
  /** Words within the frame, before what is chosen. */
  readonly words?: string | undefined;
}

/** The same in a frame, as a field. */
export function Select<T extends string | number>({ class: more = "", title, words, ...list }: SelectProps<T>) {
  const Frame = words === undefined ? "span" : "label"; // a press on the words goes to the list
  return (
    <Frame class={`select ${more}`.trim()} title={title}>
      {words !== undefined && <span aria-hidden="true">{words}</span>}
      <OptionList {...list} />
      <Icon name="down" />
    </Frame>
  );
}

interface SegmentedProps<T extends string | number> extends ChoiceProps<T> {
  readonly label: string;
  readonly value: NoInfer<T> | undefined;
  /** Further classes. */
  readonly class?: string;
}

/** Buttons side by side, of which one is pressed. */
export function Segmented<T extends string | number>({
  label,
  options,
  value,
  onChoose,
  class: more = "",
}: SegmentedProps<T>) {
  return (
    <div class={more ? `segmented ${more}` : "segmented"} role="group" aria-label={label}>
      {options.map(([one, text]) => (
        <button type="button" key={one} aria-pressed={one === value} onClick={() => onChoose(one)}>
          {text}
        </button>
      ))}
    </div>
  );
}
