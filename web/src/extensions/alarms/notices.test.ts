// @vitest-environment happy-dom
/** Browser notifications of alarms: only when asked for, allowed, and the page is not in front. */
import { beforeEach, expect, test, vi } from "vitest";
import type { EventInfo } from "../../wire/types";
import { eventInfo } from "../../testing/fixtures";
import { noticeState, notifyRaised, switchNotices } from "./notices";

const shown: [string, NotificationOptions][] = [];

class FakeNotification {
  static permission: NotificationPermission = "default";
  static answer: NotificationPermission = "granted";
  static requestPermission = vi.fn(() => {
    FakeNotification.permission = FakeNotification.answer;
    return Promise.resolve(FakeNotification.answer);
  });
  constructor(title: string, options: NotificationOptions) {
    shown.push([title, options]);
  }
}

const event = (seq: number, change: string): EventInfo => {
  const data = { alarm: "a", name: "Hot", change };
  return eventInfo({ seq, kind: "alarm", time: 900 + 30 * seq, text: `text ${seq}`, data });
};
const NOW = 1000;
const EVENTS = [event(1, "raised"), event(2, "cleared"), event(3, "raised")];

beforeEach(() => {
  shown.length = 0;
  localStorage.clear();
  FakeNotification.permission = "default";
  FakeNotification.answer = "granted";
  FakeNotification.requestPermission.mockClear();
  vi.stubGlobal("Notification", FakeNotification);
  vi.stubGlobal("isSecureContext", true);
  vi.spyOn(document, "hasFocus").mockReturnValue(false);
});
test("nothing is asked or shown before a click", () => {
  expect(noticeState()).toBe("off");
  notifyRaised(EVENTS, 0, NOW);
  expect(shown).toEqual([]);
  expect(FakeNotification.requestPermission).not.toHaveBeenCalled();
});

test("after it, what was raised since is shown, while the page is not in front", async () => {
  expect(await switchNotices()).toBe("on");
  notifyRaised(EVENTS, 1, NOW);
  expect(shown).toEqual([["Hot", { body: "text 3", tag: "a/1" }]]);
  vi.spyOn(document, "hasFocus").mockReturnValue(true);
  notifyRaised(EVENTS, 0, NOW);
  expect(shown.length).toBe(1);
  vi.spyOn(document, "hasFocus").mockReturnValue(false);
  notifyRaised(EVENTS, 1, NOW + 60);
  expect(shown.length).toBe(1); // history
  expect(await switchNotices()).toBe("off");
  vi.spyOn(document, "hasFocus").mockReturnValue(false);
  notifyRaised(EVENTS, 0, NOW);
  expect(shown.length).toBe(1);
});

test("a person may refuse, and a page without HTTPS has none", async () => {
  FakeNotification.answer = "denied";
  expect(await switchNotices()).toBe("blocked");
  vi.stubGlobal("isSecureContext", false);
  expect(noticeState()).toBe("none");
});
