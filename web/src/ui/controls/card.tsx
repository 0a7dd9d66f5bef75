/** A card in place of the plots or of a form: what has happened, and what to do next. */
import type { ComponentChildren, ComponentProps } from "preact";
import { Message } from "./message";

interface Props extends Omit<ComponentProps<"section">, "title"> {
  readonly title: ComponentChildren;
  readonly dot?: "bad" | "live" | "off" | undefined;
  readonly message?: string | undefined;
  readonly hint?: string | undefined;
}

export function Card({ title, dot, message, hint, class: more = "", children, ...rest }: Props) {
  return (
    <div class="veil">
      <section class={`card ${more}`} {...rest}>
        <h2>
          {dot && <span class={`dot ${dot}`} />}
          {title}
        </h2>
        {message && (
          <p>
            <Message text={message} />
          </p>
        )}
        {hint && <Hint text={hint} />}
        {children}
      </section>
    </div>
  );
}

export function Hint({ text }: { readonly text: string }) {
  return (
    <p class="hint">
      <Message text={text} />
    </p>
  );
}
