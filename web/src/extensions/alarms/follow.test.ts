// @vitest-environment happy-dom
/** The list of alarms beside changes of it. */
import { expect, test, vi } from "vitest";
import { newApp } from "../../testing/live-page";
import type { AlarmInfo } from "../../wire/routes";
import { followAlarms } from "./follow";
import { alarmList } from "./list";

const alarms = (id: string): readonly AlarmInfo[] => [{ id } as unknown as AlarmInfo];

test("a list that was asked for before an alarm was acknowledged, or before a newer list, is not shown", async () => {
  vi.useFakeTimers();
  const held: ((list: readonly AlarmInfo[]) => void)[] = [];
  vi.stubGlobal("fetch", () => new Promise((resolve) => held.push((list) => resolve(Response.json(list)))));
  const app = newApp();
  const list = alarmList(app.store);
  const stop = followAlarms(app);
  app.store.receive({ kind: "connection", state: "open", nextTry: undefined });
  const answer = async (list: readonly AlarmInfo[], at = 0): Promise<void> => {
    held.splice(at, 1)[0]?.(list);
    await vi.advanceTimersByTimeAsync(0);
  };
  await answer(alarms("raised"));
  await vi.advanceTimersByTimeAsync(2000);
  list.value = alarms("acknowledged");
  await answer(alarms("raised"));
  expect(list.value).toEqual(alarms("acknowledged"));
  await vi.advanceTimersByTimeAsync(4000);
  expect(held).toHaveLength(2);
  await answer(alarms("newer"), 1);
  await answer(alarms("older"));
  expect(list.value).toEqual(alarms("newer"));
  stop();
});
