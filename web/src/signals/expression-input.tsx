/** A field for an expression: completion of signals, functions and units at the caret, and the place of a mistake. */
import { type Signal, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type Completion, completionsAt, placeOf } from "./completion";
import type { ExpressionWords } from "../wire/routes";
import { TEXT } from "../texts/signals";

interface Props {
  readonly text: Signal<string>;
  /** Names of signals, as an expression has them. */
  readonly names: readonly string[];
  readonly words: ExpressionWords | undefined;
  /** What the server says about a mistake; "" without one. */
  readonly mistake: string;
  readonly onEnter: () => void;
}

export function ExpressionInput({ text, names, words, mistake, onEnter }: Props) {
  const input = useRef<HTMLInputElement>(null);
  const offered = useSignal<readonly Completion[]>([]);
  const at = useSignal(-1);
  useEffect(() => {
    // the dialog around it focuses its first button when it opens
    const frame = requestAnimationFrame(() => input.current?.focus());
    return () => cancelAnimationFrame(frame);
  }, []);
  const offer = (): void => {
    const caret = input.current?.selectionStart ?? text.peek().length;
    offered.value = completionsAt(text.peek(), caret, names, words);
    at.value = -1;
  };
  const take = (one: Completion): void => {
    text.value = text.peek().slice(0, one.from) + one.insert + text.peek().slice(one.to);
    offered.value = [];
    const caret = one.from + one.insert.length - (one.insert.endsWith(")") ? 1 : 0);
    requestAnimationFrame(() => {
      input.current?.focus();
      input.current?.setSelectionRange(caret, caret);
    });
  };
  const onKey = (event: KeyboardEvent): void => {
    const { key } = event;
    const all = offered.peek();
    if (key === "Escape" && all.length > 0) {
      event.preventDefault();
      event.stopPropagation();
      offered.value = [];
    } else if ((key === "ArrowDown" || key === "ArrowUp") && all.length > 0) {
      event.preventDefault();
      at.value = (at.peek() + (key === "ArrowDown" ? 1 : -1) + all.length) % all.length;
    } else if (key === "Enter") {
      event.preventDefault();
      const chosen = all[at.peek()];
      if (chosen) take(chosen);
      else onEnter();
    }
  };
  const place = mistake === "" ? undefined : placeOf(mistake, text.value);
  return (
    <div class="expression">
      <span class="field">
        <input
          ref={input}
          type="text"
          role="combobox"
          aria-label={TEXT.expression}
          aria-expanded={offered.value.length > 0}
          aria-controls="expression-words"
          aria-autocomplete="list"
          aria-invalid={mistake !== ""}
          aria-describedby="expression-mistake"
          {...(at.value >= 0 ? { "aria-activedescendant": `expression-word-${at.value}` } : {})}
          placeholder={TEXT.expressionHint}
          value={text.value}
          spellcheck={false}
          autocomplete="off"
          autocapitalize="off"
          onInput={(event) => {
            text.value = event.currentTarget.value;
            offer();
          }}
          onKeyDown={onKey}
          onBlur={() => (offered.value = [])}
        />
      </span>
      {place && (
        <div class="expression-place" aria-hidden="true">
          {text.value.slice(0, place.begin)}
          <mark>{text.value.slice(place.begin, place.end) || " "}</mark>
          {text.value.slice(place.end)}
        </div>
      )}
      <div id="expression-words" role="listbox" aria-label={TEXT.completions} class="expression-words">
        {offered.value.map((one, k) => (
          <div
            key={one.insert}
            id={`expression-word-${k}`}
            role="option"
            tabIndex={-1}
            aria-selected={k === at.value}
            onMouseDown={(event) => {
              event.preventDefault();
              take(one);
            }}
          >
            <b>{one.label}</b> <span>{one.doc}</span>
          </div>
        ))}
      </div>
      <p id="expression-mistake" class="expression-mistake" role="status">
        {mistake}
      </p>
    </div>
  );
}
