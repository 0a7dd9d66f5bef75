/** Completion in a field: what is offered at the caret, chosen with the arrow keys, and put in its place. */
import { type ReadonlySignal, type Signal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useMemo } from "preact/hooks";

export interface Completion {
  readonly label: string;
  readonly doc: string;
  /** Replaces the characters from ≤ i < to. */
  readonly insert: string;
  readonly from: number;
  readonly to: number;
}

/** What is offered at a field, and what is chosen of it. */
export interface Offer {
  readonly all: ReadonlySignal<readonly Completion[]>;
  /** Index of the one chosen with the arrow keys; −1 before. */
  readonly at: ReadonlySignal<number>;
  /** Offer what fits the caret now. */
  readonly open: () => void;
  readonly close: () => void;
  /** Put a completion into the text; the caret stands after it, within the parentheses of a function. */
  readonly take: (one: Completion) => void;
  /** True if the key was for the offer: an arrow, Escape, Enter with one chosen, or Tab, which takes the first. */
  readonly onKey: (event: KeyboardEvent) => boolean;
}

/** `find` gives what may stand at a caret; it must be the same function while its sources are the same. */
export function useCompletion(
  field: RefObject<HTMLInputElement | HTMLTextAreaElement | null>,
  text: Signal<string>,
  find: (text: string, caret: number) => readonly Completion[],
): Offer {
  const all = useSignal<readonly Completion[]>([]);
  const at = useSignal(-1);
  return useMemo(() => {
    const open = (): void => {
      all.value = find(text.peek(), field.current?.selectionStart ?? text.peek().length);
      at.value = -1;
    };
    const close = (): void => {
      all.value = [];
      at.value = -1;
    };
    const take = (one: Completion): void => {
      text.value = text.peek().slice(0, one.from) + one.insert + text.peek().slice(one.to);
      close();
      const caret = one.from + one.insert.length - (one.insert.endsWith(")") ? 1 : 0);
      requestAnimationFrame(() => {
        field.current?.focus();
        field.current?.setSelectionRange(caret, caret);
      });
    };
    const onKey = (event: KeyboardEvent): boolean => {
      const { length } = all.peek();
      const [first] = all.peek();
      const chosen = all.peek()[at.peek()];
      if (length === 0 || event.ctrlKey || event.metaKey) return false;
      if (event.key === "ArrowDown") at.value = (at.peek() + 1) % length;
      else if (event.key === "ArrowUp") at.value = (Math.max(0, at.peek()) - 1 + length) % length;
      else if (event.key === "Escape") close();
      else if (event.key === "Enter" && chosen) take(chosen);
      else if (event.key === "Tab" && !event.shiftKey && first) take(chosen ?? first);
      else return false;
      event.preventDefault();
      event.stopPropagation();
      return true;
    };
    return { all, at, open, close, take, onKey };
  }, [field, text, find, all, at]);
}
