/** A failed request in a dialog: what went wrong, and what to do next. */
import type { HttpProblem } from "./http";
import { Message } from "./message";

export function ProblemNote({ problem }: { readonly problem: Pick<HttpProblem, "message" | "hint"> }) {
  return (
    <div class="problem" role="alert">
      <b>
        <Message text={problem.message} />
      </b>{" "}
      <Message text={problem.hint} />
    </div>
  );
}
