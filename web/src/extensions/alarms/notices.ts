/** The browser's notifications of raised alarms: on once a person has asked for them, and only while the page is not looked at. */
import type { EventInfo } from "../../wire/types";

const KEY = "imuscope.alarm-notices";

/** `none`: this browser has none, or not without HTTPS. `blocked`: the person forbade them to this page. */
export type NoticeState = "none" | "blocked" | "off" | "on";

export function noticeState(): NoticeState {
  if (typeof Notification === "undefined" || !globalThis.isSecureContext) return "none";
  if (Notification.permission === "denied") return "blocked";
  return Notification.permission === "granted" && isWanted() ? "on" : "off";
}

function isWanted(): boolean {
  try {
    return localStorage.getItem(KEY) === "on";
  } catch {
    return false; // a browser may forbid it
  }
}

/** Switches them on or off; call it on a click, because the browser then asks the person. */
export async function switchNotices(): Promise<NoticeState> {
  const wanted = noticeState() === "off" && (await Notification.requestPermission()) === "granted";
  try {
    localStorage.setItem(KEY, wanted ? "on" : "off");
  } catch {
    // they stay off
  }
  return noticeState();
}

/** Older events are history that a new connection brings. */
const RECENT_S = 60;

/**
 * Shows a notification for each alarm that was raised after an event. A later one of the same alarm replaces it.
 * @param now the server's time, unix s
 */
export function notifyRaised(events: readonly EventInfo[], after: number, now: number): void {
  if (document.hasFocus() || noticeState() !== "on") return;
  for (const { seq, kind, time, device, text, data } of events) {
    if (seq <= after || !(time > now - RECENT_S) || kind !== "alarm" || data["change"] !== "raised") continue;
    try {
      new Notification(String(data["name"] ?? ""), { body: text, tag: `${String(data["alarm"])}/${device}` });
    } catch {
      return; // phones show them for installed pages only
    }
  }
}
