import { expect, it } from "vitest";
import { toneOfAlarms } from "./conditions";
import type { RobotSummary } from "../../../wire/routes";

it("marks alarms red only if one is an error", () => {
  const robot = (...levels: string[]) => ({
    summary: { alarms: levels.map((level) => ({ level, state: "raised", count: 1 })) } as unknown as RobotSummary,
  });
  expect(toneOfAlarms([robot("warning"), robot()])).toBe("warn");
  expect(toneOfAlarms([robot("warning"), robot("error")])).toBe("bad");
});
