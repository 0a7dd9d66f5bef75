/** A field that looks for something on the page. */
import { useLayoutEffect, useRef } from "preact/hooks";
import { Icon } from "./icons";

interface Props {
  readonly label: string;
  readonly placeholder: string;
  readonly value: string;
  readonly onText: (text: string) => void;
  readonly onKeyDown?: (event: KeyboardEvent) => void;
  /** Its key is "/". */
  readonly hasKey?: boolean;
  /** Ids of the list that its keys move through, and of the option that is chosen. */
  readonly controls?: { readonly list: string; readonly option: string | undefined };
  /** Shows it where it may be folded away. */
  readonly unfold?: () => void;
  readonly class?: string;
}

const isTyping = ({ target }: KeyboardEvent): boolean =>
  target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName);

export function SearchField({
  label,
  placeholder,
  value,
  onText,
  onKeyDown,
  hasKey,
  controls,
  unfold,
  class: more,
}: Props) {
  const field = useRef<HTMLInputElement>(null);
  // biome-ignore lint/correctness/useExhaustiveDependencies: what unfolds it stays the same
  useLayoutEffect(() => {
    if (!hasKey) return undefined;
    const onKey = (event: KeyboardEvent): void => {
      const isOurs = event.key === "/" && !event.ctrlKey && !event.metaKey && !event.altKey;
      if (!isOurs || isTyping(event) || document.querySelector("dialog[open]")) return;
      event.preventDefault();
      unfold?.();
      field.current?.focus();
      requestAnimationFrame(() => field.current?.focus()); // where it is folded away
    };
    addEventListener("keydown", onKey);
    return () => removeEventListener("keydown", onKey);
  }, []);
  return (
    <label class={`field search-field ${more ?? ""}`}>
      <Icon name="search" />
      <span class="visually-hidden">{label}</span>
      <input
        ref={field}
        type="search"
        placeholder={placeholder}
        value={value}
        autocomplete="off"
        spellcheck={false}
        {...(controls && {
          "aria-controls": controls.list,
          "aria-autocomplete": "list" as const,
          "aria-activedescendant": controls.option,
        })}
        onInput={(event) => onText(event.currentTarget.value)}
        onKeyDown={onKeyDown}
      />
      {hasKey && <kbd class="desk">/</kbd>}
    </label>
  );
}
