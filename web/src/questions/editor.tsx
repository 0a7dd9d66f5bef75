/** The editor of a question: completion at the caret, Ctrl+Enter, and the place of a mistake. */
import { useSignal } from "@preact/signals";
import { useCallback, useEffect, useRef } from "preact/hooks";
import type { Completion } from "../signals/completion";
import { completionsOfSql, placeOfMistake } from "./completion";
import type { Questions } from "./state";
import { TEXT } from "../texts/questions";

const [LEAST_LINES, MOST_LINES] = [4, 14];

export function Editor({ state }: { readonly state: Questions }) {
  const { sql, words, problem } = state;
  const area = useRef<HTMLTextAreaElement>(null);
  const offered = useSignal<readonly Completion[]>([]);
  const at = useSignal(-1);
  const isTyping = useRef(false);
  const end = useCallback((): void => {
    isTyping.current = false;
    offered.value = [];
  }, [offered]);
  const offer = useCallback((): void => {
    const caret = area.current?.selectionStart ?? sql.peek().length;
    isTyping.current = true;
    offered.value = completionsOfSql(sql.peek(), caret, words.peek());
    at.value = -1;
  }, [sql, words, offered, at]);
  useEffect(() => {
    if (words.value && isTyping.current) offer(); // they came after a letter was typed
  }, [words.value, offer]);
  const take = (one: Completion): void => {
    sql.value = sql.peek().slice(0, one.from) + one.insert + sql.peek().slice(one.to);
    end();
    const caret = one.from + one.insert.length - (one.insert.endsWith(")") ? 1 : 0);
    requestAnimationFrame(() => {
      area.current?.focus();
      area.current?.setSelectionRange(caret, caret);
    });
  };
  const onKey = (event: KeyboardEvent): void => {
    const { key } = event;
    const all = offered.peek();
    if (key === "Enter" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      end();
      void state.run();
    } else if (key === "Escape") {
      event.stopPropagation();
      if (all.length > 0) end();
      else state.cancel();
    } else if (key === " " && event.ctrlKey) {
      event.preventDefault();
      offer();
    } else if ((key === "ArrowDown" || key === "ArrowUp") && all.length > 0) {
      event.preventDefault();
      at.value = (at.peek() + (key === "ArrowDown" ? 1 : -1) + all.length) % all.length;
    } else if (key === "Enter") {
      const chosen = all[at.peek()];
      if (!chosen) return;
      event.preventDefault();
      take(chosen);
    }
  };
  const lines = Math.min(MOST_LINES, Math.max(LEAST_LINES, sql.value.split("\n").length));
  const mistake = problem.value?.kind === "bad-query" ? placeOfMistake(problem.value.message, sql.value) : undefined;
  return (
    <div class="question-editor">
      <textarea
        ref={area}
        id="question"
        rows={lines}
        aria-label={TEXT.editor}
        aria-controls="question-words"
        aria-autocomplete="list"
        aria-invalid={mistake !== undefined}
        aria-describedby="question-problem"
        {...(at.value >= 0 ? { "aria-activedescendant": `question-word-${at.value}` } : {})}
        placeholder={TEXT.rowsFromStart}
        spellcheck={false}
        autocomplete="off"
        autocapitalize="off"
        wrap="soft"
        value={sql.value}
        onInput={(event) => {
          sql.value = event.currentTarget.value;
          offer();
        }}
        onKeyDown={onKey}
        onBlur={end}
      />
      <div id="question-words" role="listbox" aria-label={TEXT.completions} class="question-words">
        {offered.value.map((one, k) => (
          <div
            key={`${one.insert} ${one.label}`}
            id={`question-word-${k}`}
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
      {mistake && <MistakeLine text={sql.value} at={mistake.at} />}
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
      {text.slice(begin, at)}
      <mark>{word || " "}</mark>
      {text.slice(at + word.length, end < 0 ? undefined : end)}
    </div>
  );
}
