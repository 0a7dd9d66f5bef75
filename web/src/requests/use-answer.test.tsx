// @vitest-environment happy-dom
/** What is asked for again and again, beside changes of it. */
import { act, render, screen } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import type { HttpProblem, Outcome } from "./http";
import { Answered, type Asked, useAnswer } from "./use-answer";

const EVERY_MS = 1000;
const REFUSED: HttpProblem = { kind: "refused", message: "Refused.", hint: "", status: 409 };
const AWAY: HttpProblem = { kind: "offline", message: "Away.", hint: "", status: 0 };

const ok = (value: string): Outcome<string> => ({ ok: true, value });
const no = (problem: HttpProblem): Outcome<string> => ({ ok: false, problem });

/** Answers of the server, in the order of its questions, each given when the test says so. */
let answers: ((outcome: Outcome<string>) => void)[] = [];
let asked: Asked<string>;

function Shown({ of }: { readonly of: string }) {
  asked = useAnswer(of, () => new Promise<Outcome<string>>((resolve) => answers.push(resolve)), { everyMs: EVERY_MS });
  return (
    <Answered of={asked} waiting="nothing">
      {(answer) => <p>{answer}</p>}
    </Answered>
  );
}

const shown = (): string => document.body.textContent ?? "";
const isDimmed = (): boolean => document.querySelector(".result[data-old]") !== null;

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
  const isSent = asked.send(Promise.resolve(ok("on")));
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
  void asked.send(Promise.resolve(no(REFUSED)));
  await pass(EVERY_MS);
  await answer(ok("off"));
  await pass(EVERY_MS);
  await answer(ok("off"));
  expect(shown()).toBe("Refused. off");
  void asked.send(Promise.resolve(ok("on")));
  await pass(EVERY_MS);
  await answer(no(AWAY));
  expect([shown(), isDimmed()]).toEqual(["Away. on", true]); // of a server that is gone: held, and dimmed
  await pass(EVERY_MS);
  await answer(ok("on"));
  expect([shown(), isDimmed()]).toEqual(["on", false]);
});

const askOther = (of: string): void =>
  void render(<Shown of={of} />, { container: document.body.firstElementChild as HTMLElement });

/** Regression: the figures of A against A stood undimmed under "B IMX-5". */
test("an answer is dimmed as soon as another question is asked, and its late answer is ignored", async () => {
  await answer(ok("one"));
  await pass(EVERY_MS);
  askOther("2");
  expect([shown(), isDimmed()]).toEqual(["one", true]);
  await pass(50);
  await answer(ok("one"));
  expect([shown(), isDimmed()]).toEqual(["one", true]);
  await answer(ok("two"));
  expect([shown(), isDimmed()]).toEqual(["two", false]);
});

test("an error takes the place of an answer, also if the server is away before another question is answered", async () => {
  await answer(ok("one"));
  for (const [of, problem] of [
    ["2", REFUSED],
    ["3", AWAY],
  ] as const) {
    askOther(of);
    await pass(50);
    await answer(no(problem));
    expect(shown()).toContain(problem.message);
    expect(shown()).not.toContain("one");
  }
});
