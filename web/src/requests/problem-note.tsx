/** A failed request in a dialog: what went wrong, and what to do next. */
import type { HttpProblem } from "./http";
import { Message } from "../ui/controls/message";

interface Props {
  readonly problem: Pick<HttpProblem, "message" | "hint">;
  readonly class?: string;
  readonly id?: string;
}

export function ProblemNote({ problem, class: more = "", id }: Props) {
  return (
    <div class={`problem ${more}`} id={id} role="alert">
      <b>
        <Message text={problem.message} />
      </b>{" "}
      <Message text={problem.hint} />
    </div>
  );
}
