/** Answers of a fleet server, in any order and repeated, lead to what the server knows. */
import { describe, expect, it } from "vitest";
import { robotWith } from "./fixtures";
import type { FleetRobots, RobotSummary } from "../../../wire/routes";
import { Robots } from "./robots";

/** A small generator, so that a failing case comes again. */
function dice(seed: number): (sides: number) => number {
  let state = seed + 0x9e3779b9;
  return (sides) => {
    state = Math.imul(state ^ (state >>> 15), 0x2c1b3c6d) + 0x6d2b79f5;
    state ^= state >>> 13;
    return (state >>> 0) % sides;
  };
}

/** The obvious server: a log of changes that is read from the beginning. */
class SlowServer {
  readonly changes: { readonly name: string; readonly summary: RobotSummary | undefined }[] = [];
  first = 1000;

  get revision(): number {
    return this.first + this.changes.length;
  }

  state(): Map<string, RobotSummary> {
    const state = new Map<string, RobotSummary>();
    for (const { name, summary } of this.changes) {
      if (summary) state.set(name, summary);
      else state.delete(name);
    }
    return state;
  }

  answer(after: number | undefined): FleetRobots {
    const isKnown = after !== undefined && after >= this.first && after <= this.revision;
    const state = this.state();
    const names = isKnown ? this.changes.slice(after - this.first).map(({ name }) => name) : [...state.keys()];
    const robots = [...new Set(names)].flatMap((name) => state.get(name) ?? []);
    const gone = isKnown ? [...new Set(names)].filter((name) => !state.has(name)) : [];
    return { revision: this.revision, time: this.revision, complete: !isKnown, gone, robots };
  }
}

const known = (robots: Robots): Map<string, RobotSummary> =>
  new Map([...robots.all].map(([name, { summary }]) => [name, summary]));

describe("robots", () => {
  it("end as on the server, whatever the order of answers and however often they come", () => {
    for (let seed = 0; seed < 200; seed++) {
      const roll = dice(seed);
      const server = new SlowServer();
      const robots = new Robots();
      expect(robots.apply(server.answer(undefined), undefined)).toBe(true);
      const answers: { readonly answer: FleetRobots; readonly after: number }[] = [];
      for (let step = 0; step < 40; step++) {
        const name = `amr-${roll(8)}`;
        const isGone = roll(5) === 0;
        server.changes.push({ name, summary: isGone ? undefined : robotWith({ name, drifted: step }) });
        const after = server.first + roll(server.changes.length + 1);
        answers.push({ answer: server.answer(after), after });
        const late = answers[roll(answers.length)];
        const before = known(robots);
        // an answer that leaves out what is not known yet is refused, and changes nothing
        if (late && !robots.apply(late.answer, late.after)) expect(known(robots)).toEqual(before);
      }
      const after = robots.revision;
      expect(robots.apply(server.answer(after), after)).toBe(true);
      expect(known(robots)).toEqual(server.state());
    }
  });

  it("are read again when the revisions have begun again", () => {
    const [old, server] = [new SlowServer(), new SlowServer()];
    old.changes.push(...["a", "b"].map((name) => ({ name, summary: robotWith({ name }) })));
    const robots = new Robots();
    robots.apply(old.answer(undefined), undefined);
    for (const first of [10, 5000]) {
      server.first = first;
      server.changes.push({ name: `c${first}`, summary: robotWith({ name: `c${first}` }) });
      const after = robots.revision;
      expect(robots.apply(server.answer(after), after)).toBe(true);
      expect(known(robots)).toEqual(server.state());
    }
    expect(robots.revision).toBe(server.revision);
    expect(robots.get("a")?.summary.name).toBe("a"); // its row may still be on screen
  });

  it("are not taken from an answer to a question that was not asked", () => {
    const robots = new Robots();
    expect(robots.apply({ ...new SlowServer().answer(1000), complete: false }, 1000)).toBe(false);
    expect(robots.revision).toBeUndefined();
  });
});
