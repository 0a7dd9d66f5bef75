/** A button that shows an icon alone: its label is read aloud, and shown while the pointer is over it. */
import type { ComponentProps } from "preact";
import { refusal, type Rights } from "./button";
import { Icon, type IconName } from "./icons";

interface Props extends Omit<ComponentProps<"button">, "aria-label" | "class" | "icon" | "title" | "type">, Rights {
  readonly icon: IconName;
  readonly label: string;
  /** Below it, where the bar has room. */
  readonly word?: string;
  /** Shown over it where it says more than the label, its key for example. */
  readonly title?: string;
  /** Further classes. */
  readonly class?: string;
}

export function IconButton({ icon, label, word, title = label, class: more = "", changes = false, ...rest }: Props) {
  return (
    <button
      type="button"
      class={`btn icon ${word ? "worded" : ""} ${more}`}
      aria-label={label}
      title={title}
      {...rest}
      {...refusal(changes)}
    >
      <Icon name={icon} />
      {word && <span class="icon-word">{word}</span>}
    </button>
  );
}
