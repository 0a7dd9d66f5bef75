// @vitest-environment happy-dom
/** What is asked for again and again, beside changes of it. */
import { act, render, screen } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import type { HttpProblem, Outcome } from "./http";
import { type Polled, usePolled } from "./use-polled";

const EVERY_MS = 1000;
const REFUSED: HttpProblem = { kind: "refused", message: "Refused.", hint: "", status: 409 };
const AWAY: HttpProblem = { kind: "offline", message: "Away.", hint: "", status: 0 };

const ok = (value: string): Outcome<string> => ({ ok: true, value });
const no = (problem: HttpProblem): Outcome<string> => ({ ok: false, problem });

/** Answers of the server, in the order of its questions, each given when the test says so. */
let answers: ((outcome: Outcome<string>) => void)[] = [];
let polled: Polled<string>;

function Shown({ of }: { readonly of: string }) {
  polled = usePolled(of, EVERY_MS, () => new Promise<Outcome<string>>((resolve) => answers.push(resolve)));
  return (
    <p>
      {polled.state.value ?? "nothing"} {polled.problem.value?.message}
    </p>
  );
}

const pass = (ms: number): Promise<void> => act(async () => void (await vi.advanceTimersByTimeAsync(ms)));
const answer = async (outcome: Outcome<string>): Promise<void> => {
  answers.shift()?.(outcome);
  await pass(0);
};

beforeEach(async () => {
  vi.useFakeTimers();
  answers = [];
  render(<Shown of="1" />);
  await pass(50);
});
test("an answer that was asked for before a change was made does not undo it", async () => {
  await answer(ok("off"));
  await pass(EVERY_MS);
  expect(answers).toHaveLength(1);
  const isSent = polled.send(Promise.resolve(ok("on")));
  await pass(0);
  expect(await isSent).toBe(true);
  await answer(ok("off"));
  expect(screen.getByText("on")).toBeTruthy();
  await pass(EVERY_MS);
  await answer(ok("on again"));
  expect(screen.getByText("on again")).toBeTruthy();
});

test("why a change was refused stays until the next one; that the server was away ends with its answer", async () => {
  await answer(ok("off"));
  void polled.send(Promise.resolve(no(REFUSED)));
  await pass(EVERY_MS);
  await answer(ok("off"));
  await pass(EVERY_MS);
  await answer(ok("off"));
  expect(screen.getByText("off Refused.")).toBeTruthy();
  void polled.send(Promise.resolve(ok("on")));
  await pass(EVERY_MS);
  await answer(no(AWAY));
  expect(screen.getByText("on Away.")).toBeTruthy();
  await pass(EVERY_MS);
  await answer(ok("on"));
  expect(screen.getByText("on")).toBeTruthy();
});

test("another key is requested again, and an answer to the previous key is ignored", async () => {
  await answer(ok("one"));
  await pass(EVERY_MS);
  render(<Shown of="2" />, { container: document.body.firstElementChild as HTMLElement });
  await pass(50);
  expect(screen.getByText("nothing")).toBeTruthy();
  await answer(ok("one"));
  expect(screen.getByText("nothing")).toBeTruthy();
  await answer(ok("two"));
  expect(screen.getByText("two")).toBeTruthy();
});
