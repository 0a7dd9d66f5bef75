/** A field for an expression: completion of signals, functions and units at the caret, and the place of a mistake. */
import type { Signal } from "@preact/signals";
import { useCallback, useEffect, useRef } from "preact/hooks";
import { CompletionList, completed } from "../../ui/completion/completion-list";
import { MarkedMistake } from "../../ui/completion/mistake";
import { useCompletion } from "../../ui/completion/use-completion";
import { completionsAt, mistakePlace } from "./completion";
import type { ExpressionWords } from "../../wire/routes";
import { TEXT } from "./texts";

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
  const find = useCallback((typed: string, caret: number) => completionsAt(typed, caret, names, words), [names, words]);
  const offer = useCompletion(input, text, find);
  useEffect(() => {
    // also on a phone, where the dialog around it keeps the focus on its heading
    const frame = requestAnimationFrame(() => input.current?.focus());
    return () => cancelAnimationFrame(frame);
  }, []);
  const onKey = (event: KeyboardEvent): void => {
    if (offer.onKey(event) || event.key !== "Enter") return;
    event.preventDefault();
    onEnter();
  };
  const place = mistake === "" ? undefined : mistakePlace(mistake, text.value);
  return (
    <div class="expression">
      <span class="field">
        <input
          ref={input}
          type="text"
          role="combobox"
          aria-label={TEXT.expression}
          aria-expanded={offer.all.value.length > 0}
          {...completed("expression-words", offer)}
          aria-invalid={mistake !== ""}
          aria-describedby="expression-mistake"
          placeholder={TEXT.expressionHint}
          value={text.value}
          spellcheck={false}
          autocomplete="off"
          autocapitalize="off"
          onInput={(event) => {
            text.value = event.currentTarget.value;
            offer.open();
          }}
          onKeyDown={onKey}
          onBlur={offer.close}
        />
      </span>
      {place && (
        <div class="expression-place mid text-sm" aria-hidden="true">
          <MarkedMistake text={text.value} {...place} />
        </div>
      )}
      <CompletionList id="expression-words" offer={offer} />
      <p id="expression-mistake" class="expression-mistake" role="status">
        {mistake}
      </p>
    </div>
  );
}
