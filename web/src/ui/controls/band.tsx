/** A band over a page: what is wrong or to be known, never on the data. */
import type { ComponentChildren, ComponentProps } from "preact";

interface Props extends Omit<ComponentProps<"div">, "title"> {
  /** Without one, something is wrong. */
  readonly tone?: "calm" | "warning" | undefined;
  readonly dot: "bad" | "off" | "warn";
  readonly title: ComponentChildren;
  /** More about it, before the room that keeps actions at the end. */
  readonly words?: ComponentChildren;
}

export function Band({ tone, dot, title, words, children, ...rest }: Props) {
  return (
    <div class={`band ${tone ?? ""}`} role={tone ? "status" : "alert"} {...rest}>
      <span class={`dot ${dot}`} />
      <b>{title}</b>
      {words !== undefined && <span class="mid">{words}</span>}
      {words !== undefined && <span class="grow" />}
      {children}
    </div>
  );
}
