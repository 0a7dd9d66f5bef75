/** A button with words, and perhaps an icon before them. */
import type { ComponentChildren, ComponentProps } from "preact";
import { isViewOnly } from "../../wire/capabilities";
import { Icon, type IconName } from "./icons";
import { COMMON } from "../../texts/common";

export interface Rights {
  /** Its request, or what it opens, changes something: disabled for who may only look, with the reason. */
  readonly changes?: boolean;
}

interface Props extends Omit<ComponentProps<"button">, "class" | "icon">, Rights {
  /** Classes: "main" for what a form is for, "edge" with a frame, "small"; and its own. */
  readonly look?: string;
  readonly icon?: IconName;
  readonly words?: ComponentChildren;
}

/** What becomes of a control that changes something, for who may only look. */
export const refusal = (changes: boolean): { readonly disabled?: true; readonly title?: string } =>
  changes && isViewOnly.value ? { disabled: true, title: COMMON.viewOnlyHint } : {};

export function Button({ look = "", icon, words, changes = false, children, ...rest }: Props) {
  return (
    <button type="button" class={look ? `btn ${look}` : "btn"} {...rest} {...refusal(changes)}>
      {icon && <Icon name={icon} />}
      {words}
      {children}
    </button>
  );
}
