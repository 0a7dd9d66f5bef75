/** A button with words, and perhaps an icon before them. */
import type { ComponentChildren, ComponentProps } from "preact";
import { Icon, type IconName } from "./icons";

interface Props extends Omit<ComponentProps<"button">, "class" | "icon"> {
  /** Classes: "main" for what a form is for, "edge" with a frame, "small"; and its own. */
  readonly look?: string;
  readonly icon?: IconName;
  readonly words?: ComponentChildren;
}

export function Button({ look = "", icon, words, children, ...rest }: Props) {
  return (
    <button type="button" class={look ? `btn ${look}` : "btn"} {...rest}>
      {icon && <Icon name={icon} />}
      {words}
      {children}
    </button>
  );
}
