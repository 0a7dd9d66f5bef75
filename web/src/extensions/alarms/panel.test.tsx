// @vitest-environment happy-dom
/** The list of alarms: states in words and symbols, acknowledged by name; and the intervals from events. */
import { signal } from "@preact/signals";
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { beforeEach, expect, test } from "vitest";
import { newApp } from "../../testing/live-page";
import { answering } from "../../testing/recorded";
import type { AlarmInfo, AlarmState } from "../../wire/routes";
import type { EventInfo } from "../../wire/types";
import { eventInfo } from "../../testing/fixtures";
import { alarmCounts, alarmMark, alarmsOf, idleAlarms, raisedSpans, valueText } from "./states";
import { alarmList } from "./list";
import { AlarmTags } from "./tags";
import "./index";
import { panelsAt } from "../../panels/registry";

const STATE: AlarmState = {
  device: "1",
  status: "ok",
  raised: false,
  since: null,
  value: 9.81,
  raised_value: null,
  worst: null,
  limit: 29.42,
  subject: "norm(Acceleration)",
  unit: "m/s²",
  count: 0,
  acknowledged_by: "",
  acknowledged: null,
  problem: "",
  signals: ["Acceleration.x"],
  intervals: [],
};
const RAISED = { status: "raised", raised: true, since: 100, raised_value: 31.42, worst: 33, count: 1 } as const;

function alarm(id: string, state: Partial<AlarmState>, level: "warning" | "error" = "warning"): AlarmInfo {
  const condition = { kind: "expression", expression: `${id} > 3 g`, clear: "" } as const;
  return { id, definition: { name: `Alarm ${id}`, condition, level }, states: [{ ...STATE, ...state }] };
}

beforeEach(() => localStorage.clear());
function panel(alarms: readonly AlarmInfo[]) {
  const app = newApp();
  app.viewState.view.value = { ...app.viewState.view.value, device: "1" };
  alarmList(app.store).value = alarms;
  const found = panelsAt("below", app).find(({ id }) => id === "alarms");
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  found?.mount(host, app, null);
  return app;
}

test("what needs attention is first, with a symbol and a word", () => {
  const seen = { ...RAISED, status: "acknowledged", acknowledged: 120, acknowledged_by: "Ada" } as const;
  const all = [
    alarm("ok", {}),
    alarm("seen", seen),
    alarm("missing", { status: "missing" }),
    alarm("raised", RAISED),
    alarm("worse", RAISED, "error"),
  ];
  const own = alarmsOf(all, "1");
  expect(own.map((one) => one.alarm.id)).toEqual(["worse", "raised", "seen", "missing", "ok"]);
  const marks = own.map((one) => alarmMark(one));
  expect(new Set(marks.map(({ symbol }) => symbol)).size).toBe(5);
  expect(marks.map(({ tone }) => tone)).toEqual(["bad", "warn", "warn", "", ""]);
  expect(alarmCounts(own)).toEqual({ raised: 2, worst: "error", acknowledged: 1, missing: 1 });
  expect(idleAlarms([{ ...alarm("idle", {}), states: [] }, alarm("ok", {})])).toHaveLength(1);
});

test("an alarm that was raised and has no data is neither ok nor forgotten", () => {
  const marks = alarmsOf([alarm("a", { ...RAISED, status: "missing" })], "1").map(alarmMark);
  expect(marks[0]).toEqual({ symbol: "?", word: "Raised, no data", tone: "warn" });
});

test("an alarm that cannot be judged is not ok, and one that was raised stays so", () => {
  const problem = "Decoding is 12 s behind the data received. Reduce the load of this computer.";
  const own = alarmsOf([alarm("a", { ...RAISED, problem }), alarm("b", { status: "ok", problem })], "1");
  expect(own.map(alarmMark)).toEqual([
    { symbol: "?", word: "Raised, not evaluated", tone: "warn" },
    { symbol: "?", word: "Not evaluated", tone: "" },
  ]);
  expect(alarmCounts(own)).toMatchObject({ raised: 1, missing: 1 });
});

test("a raised alarm is acknowledged by name, which is kept for the next one", async () => {
  const seen = alarm("a", { ...RAISED, status: "acknowledged", acknowledged: 120, acknowledged_by: "Ada" });
  const asked = answering({ "POST /api/alarms/a/acknowledge": seen });
  const app = panel([alarm("a", RAISED)]);
  expect(document.body.textContent).toContain("raised at 31.42 m/s², worst 33.00 m/s²");
  fireEvent.click(screen.getByRole("button", { name: "Acknowledge Alarm a" }));
  const name = await screen.findByLabelText<HTMLInputElement>("Your name");
  fireEvent.input(name, { target: { value: "Ada" } });
  fireEvent.submit(name.form as HTMLFormElement);
  await waitFor(() => expect(alarmList(app.store).value).toEqual([seen]));
  expect(asked.at(-1)?.body).toEqual({ by: "Ada", device: "1" });
  await waitFor(() => expect(document.body.textContent).toContain("by Ada"));
  expect(screen.queryByRole("button", { name: "Acknowledge Alarm a" })).toBeNull();
  alarmList(app.store).value = [alarm("a", RAISED)];
  fireEvent.click(await screen.findByRole("button", { name: "Acknowledge Alarm a" }));
  expect((await screen.findByLabelText<HTMLInputElement>("Your name")).value).toBe("Ada");
});

test("a refused acknowledgement says why", async () => {
  answering({});
  panel([alarm("a", RAISED)]);
  fireEvent.click(screen.getByRole("button", { name: "Acknowledge Alarm a" }));
  const name = await screen.findByLabelText<HTMLInputElement>("Your name");
  fireEvent.input(name, { target: { value: "Ada" } });
  fireEvent.submit(name.form as HTMLFormElement);
  expect(await screen.findByRole("alert")).toBeTruthy();
});

test("the row of a device counts its alarms, and is quiet while all is well", () => {
  const alarms = signal([alarm("a", {})]);
  const { container, rerender } = render(<AlarmTags alarms={alarms.value} device="1" />);
  expect(container.textContent).toBe("");
  rerender(<AlarmTags alarms={[alarm("a", RAISED, "error"), alarm("b", RAISED)]} device="1" />);
  expect(container.textContent).toBe("✖ 2 alarms raised");
  rerender(<AlarmTags alarms={[alarm("a", RAISED)]} device="2" />);
  expect(container.textContent).toBe("");
});

test("values have four digits and their unit", () => {
  expect(valueText(31.4159, "m/s²")).toBe("31.42 m/s²");
  expect(valueText(0.0123, "°")).toBe("0.01230°");
  expect(valueText(null, "N")).toBe("");
});

const event = (change: string, time: number, data: Record<string, unknown> = {}, device = "1"): EventInfo =>
  eventInfo({ time, device, kind: "alarm", data: { alarm: "a", name: "A", change, ...data } });

test("intervals come from events: ended ones, the present one, and what was summed up", () => {
  const spans = raisedSpans(
    [
      event("raised", 10, { t0: 10, limit: 3, signals: ["X.x"], subject: "X.x" }),
      event("raised", 11, {}, "2"),
      event("cleared", 12, { t0: 10, t1: 12 }),
      event("repeated", 20, { t0: 15, t1: 20, times: 30, is_raised: false }),
      event("missing", 21),
      event("raised", 30, { t0: 30 }),
    ],
    "1",
  );
  expect(spans.map(({ t0, t1 }) => [t0, t1])).toEqual([
    [10, 12],
    [15, 20],
    [30, undefined],
  ]);
  expect(spans[0]).toMatchObject({ limit: 3, signals: ["X.x"], subject: "X.x" });
});

test("an alarm whose beginning is no longer among the events still has its interval", () => {
  expect(raisedSpans([event("cleared", 12, { t0: 4 })], "1")[0]).toMatchObject({ t0: 4, t1: 12 });
});
