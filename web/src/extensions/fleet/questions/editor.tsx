/** The editor of a question: completion at the caret, Ctrl+Enter, and the place of a mistake. */
import { useCallback, useEffect, useRef } from "preact/hooks";
import { CompletionList, completed } from "../../../ui/completion/completion-list";
import { MarkedMistake } from "../../../ui/completion/mistake";
import { useCompletion } from "../../../ui/completion/use-completion";
import { completionsOfSql, placeOfMistake } from "./completion";
import type { Questions } from "./state";
import { TEXT } from "./texts";

const [LEAST_LINES, MOST_LINES] = [4, 14];

export function QuestionEditor({ state }: { readonly state: Questions }) {
  const { sql, words, problem } = state;
  const area = useRef<HTMLTextAreaElement>(null);
  const isTyping = useRef(false);
  const find = useCallback((typed: string, caret: number) => completionsOfSql(typed, caret, words.peek()), [words]);
  const offer = useCompletion(area, sql, find);
  useEffect(() => {
    if (words.value && isTyping.current) offer.open(); // they came after a letter was typed
  }, [words.value, offer]);
  const end = (): void => {
    isTyping.current = false;
    offer.close();
  };
  const onKey = (event: KeyboardEvent): void => {
    const { key } = event;
    if (offer.onKey(event)) return;
    if (key === "Enter" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      end();
      void state.run();
    } else if (key === "Escape") {
      event.stopPropagation();
      state.cancel();
    } else if (key === " " && event.ctrlKey) {
      event.preventDefault();
      offer.open();
    }
  };
  const lines = Math.min(MOST_LINES, Math.max(LEAST_LINES, sql.value.split("\n").length));
  const place = problem.value?.kind === "bad-query" ? placeOfMistake(problem.value.message, sql.value) : undefined;
  return (
    <div class="question-editor">
      <textarea
        ref={area}
        id="question"
        rows={lines}
        aria-label={TEXT.editor}
        {...completed("question-words", offer)}
        aria-invalid={place !== undefined}
        aria-describedby="question-problem"
        placeholder={TEXT.rowsFromStart}
        spellcheck={false}
        autocomplete="off"
        autocapitalize="off"
        wrap="soft"
        value={sql.value}
        onInput={(event) => {
          sql.value = event.currentTarget.value;
          isTyping.current = true;
          offer.open();
        }}
        onKeyDown={onKey}
        onBlur={end}
      />
      <CompletionList id="question-words" offer={offer} />
      {place !== undefined && <MistakeLine text={sql.value} at={place} />}
    </div>
  );
}

/** The line of a mistake, marked from its place to the end of the word there. */
function MistakeLine({ text, at }: { readonly text: string; readonly at: number }) {
  const begin = text.lastIndexOf("\n", at - 1) + 1;
  const end = text.indexOf("\n", at);
  const word = /^(\w+|"[^"]*"|.)/.exec(text.slice(at))?.[0] ?? "";
  return (
    <div class="question-mistake" aria-hidden="true">
      <MarkedMistake
        text={text.slice(begin, end < 0 ? undefined : end)}
        begin={at - begin}
        end={at - begin + word.length}
      />
    </div>
  );
}
