// @vitest-environment happy-dom
/** The traffic log beside the settings, and bytes by hand. */
import { fireEvent, render, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { ConfigurePage } from "../../pages/configure/page";
import { openConfigure } from "../../testing/configure-page";
import { newApp } from "../../testing/live-page";
import type { TrafficEntry } from "../../wire/types";
import "./index";
import { bodiesOf, buttonOf as button, find, job, until } from "../../testing/queries";

test("bytes by hand are checked, asked about, sent as they are, and found in the log", async () => {
  const message = "GoToConfig: Stop measuring.";
  const asked = Response.json({ kind: "confirm", message, hint: "" }, { status: 409 });
  const answers = {
    'POST /api/devices/1/raw {"confirmed":false,"hex":"faff3000d1"}': asked,
    'POST /api/devices/1/raw {"confirmed":true,"hex":"faff3000d1"}': job(2, { state: "waiting" }),
  };
  const page = await openConfigure("xbus", { answers });
  fireEvent.click(await waitFor(() => button("Send hex")));
  expect(find("#byhand-why").textContent).toContain("one valid message that only asks is sent at once"); // what is checked
  const field = screen.getByLabelText("Bytes to send (hex)");
  fireEvent.input(field, { target: { value: "FA FF 0" } });
  await waitFor(() => expect(find("#byhand-why").textContent).toContain("two hex digits"));
  fireEvent.input(field, { target: { value: "FA FF 30 00 D1" } });
  await waitFor(() => expect((find(".send-bytes button") as HTMLButtonElement).disabled).toBe(false));
  fireEvent.submit(find(".send-bytes"));
  const question = await until("dialog");
  expect(question.textContent).toContain(message);
  fireEvent.click(button("Send", question));
  await waitFor(() =>
    expect(bodiesOf(page, "/api/devices/1/raw")).toMatchObject([{ confirmed: false }, { confirmed: true }]),
  );
  const entry = (seq: number, name: string, direction: "tx" | "rx"): TrafficEntry => ({
    ...{ seq, name, direction, time: 1_790_000_000 + seq, device: "1", hex: "faff3100d0", text: "" },
    ...{ ms: direction === "rx" ? 1.5 : null, level: "info" },
  });
  const entries = [entry(9001, "GoToConfig", "tx"), entry(9002, "GoToConfigAck", "rx"), entry(9003, "Reset", "tx")];
  page.store.receive({ kind: "text", text: { op: "traffic", entries } });
  const names = (): readonly (string | null)[] =>
    [...document.querySelectorAll(".log-entry b")].map(({ textContent }) => textContent);
  await waitFor(() => expect(names().slice(-3)).toEqual(["GoToConfig", "GoToConfigAck", "Reset"]));
  expect([...document.querySelectorAll(".log-entry.received b")].at(-1)?.textContent).toBe("GoToConfigAck");
  fireEvent.click(button("Filter"));
  fireEvent.input(screen.getByPlaceholderText("Name, bytes or text"), { target: { value: "gotoconf" } });
  await waitFor(() => expect(names().every((name) => /gotoconf/i.test(name ?? ""))).toBe(true));
  expect(names().slice(-2)).toEqual(["GoToConfig", "GoToConfigAck"]);
});

test("the last line of the log stays in sight when what stands under it grows", async () => {
  let resize = (): void => {};
  class Observer {
    constructor(readonly changed: () => void) {}
    observe(element: Element): void {
      if (element.classList.contains("log-box")) resize = this.changed;
    }
    disconnect(): void {}
  }
  vi.stubGlobal("ResizeObserver", Observer);
  await openConfigure("xbus");
  const box = await until(".log-box");
  Object.defineProperty(box, "scrollHeight", { value: 900 });
  box.scrollTop = 0;
  resize();
  expect(box.scrollTop).toBe(900);
});

test("who may only look has no bytes to send", async () => {
  await openConfigure("xbus", { isViewOnly: true });
  await waitFor(() => expect(button("Send hex").disabled).toBe(true));
});

test("two pages beside each other have their own bytes by hand, and their own questions", async () => {
  const asked = Response.json({ kind: "confirm", message: "Sure.", hint: "" }, { status: 409 });
  const { store } = await openConfigure("xbus", { answers: { "POST /api/devices/1/raw": asked } });
  render(<ConfigurePage app={newApp(store)} />);
  const [left, right] = [...document.querySelectorAll<HTMLElement>(".app.configure")];
  if (left === undefined || right === undefined) throw new Error("not two pages");
  fireEvent.click(await within(left).findByRole("button", { name: "Send hex" }));
  fireEvent.input(await within(left).findByLabelText("Bytes to send (hex)"), { target: { value: "fa ff 30 00 d1" } });
  fireEvent.submit(left.querySelector(".send-bytes") as HTMLElement);
  await waitFor(() => expect(left.querySelector("dialog")).not.toBeNull());
  expect(right.querySelector("dialog, .send-bytes")).toBeNull();
});

test("after the server was started again the log has the entries of that run alone", async () => {
  const entry = (seq: number, name: string): TrafficEntry => ({
    ...{ seq, name, direction: "tx" as const, time: 1_790_000_000 + seq, device: "1", hex: "faff", text: "" },
    ...{ ms: null, level: "info" as const },
  });
  let log = [entry(9001, "GoToConfig"), entry(9002, "Reset")];
  const { store } = await openConfigure("xbus", { answers: { "GET /api/devices/1/traffic?limit=200": () => log } });
  const names = (): readonly (string | null)[] =>
    [...document.querySelectorAll(".log-entry b")].map(({ textContent }) => textContent);
  await waitFor(() => expect(names()).toContain("Reset"));
  const devices = [...store.jobs.peek().values()];
  log = [entry(9001, "ReqDID")];
  store.receive({ kind: "connection", state: "closed", nextTry: undefined });
  store.receive({ kind: "connection", state: "open", nextTry: undefined });
  store.receive({ kind: "subscribed", fresh: true });
  store.receive({ kind: "text", text: { op: "jobs", devices } });
  await waitFor(() => expect(names()).toEqual(["ReqDID"]));
});
