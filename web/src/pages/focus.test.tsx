// @vitest-environment happy-dom
/** Who may take the focus: what a person opened, and the banner of a change in the page that wrote it. */
import { fireEvent, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { openConfigure } from "../testing/configure-page";
import { buttonOf as button, find, job, until } from "../testing/queries";
import type { PendingRollback } from "../wire/types";
import { configureOf } from "./configure/view-state";

const SOURCES = import.meta.glob<string>(["../**/*.{ts,tsx}", "!../**/*.test.*", "!../testing/**"], {
  query: "?raw",
  import: "default",
  eager: true,
});

/** Focus that code takes by itself: in an effect, when an element appears, or with the next frame. */
const BY_ITSELF =
  /use(?:Layout)?Effect\(\(\) => (?:[^;{}]|\{(?:[^{}]|\{[^{}]*\})*?)*?\.focus\(|ref=\{\([^}]*?\.focus\(|requestAnimationFrame\([^;]*\.focus\(/;

/** Each is on screen because a person pressed something just now. */
const OPENED_BY_A_PERSON = [
  "../ui/completion/use-completion.ts",
  "../extensions/alarms/panel.tsx",
  "../extensions/expressions/new-signal.tsx",
  "../extensions/fleet/robots/details.tsx",
  "../extensions/fleet/robots/person-form.tsx",
  "../extensions/moments/go-to.tsx",
  "../extensions/notes/panel.tsx",
  "../forms/add-device.tsx",
  "../pages/configure/page.tsx",
  "../pages/configure/snapshot.tsx",
  "../pages/record-button.tsx",
  "../pages/recordings/markers.tsx",
  "../pages/tour.tsx",
  "../panels/signals/panel.tsx",
  "../ui/controls/dialog.tsx",
  "../ui/controls/search-field.tsx",
  "../workspace/arrange.tsx",
  "../workspace/tile-grip.tsx",
];
/** Only after a press of this very page, and never on a button (below). */
const OF_THE_WRITER = ["./configure/apply-bar.tsx", "./configure/rollback-banner.tsx"];

test("nothing takes the focus by itself but what a person opened", () => {
  const takers = Object.entries(SOURCES).flatMap(([file, source]) => (BY_ITSELF.test(source) ? [file] : []));
  const allowed = new Set([...OPENED_BY_A_PERSON, ...OF_THE_WRITER].map((file) => file.replace("../pages/", "./")));
  expect(takers.filter((file) => !allowed.has(file))).toEqual([]);
  expect(takers).toContain("./configure/rollback-banner.tsx"); // the pattern finds what it is for
});

const STATES: readonly PendingRollback["state"][] = [
  ...(["applying", "pending", "rolling-back", "confirmed", "rolled-back", "unreachable"] as const),
];
const rollback = (state: PendingRollback["state"]): { readonly pending_rollback: PendingRollback } => {
  const deadline = Date.now() / 1000 + 20;
  return { pending_rollback: { device: "1", state, changes: ["a → b"], words: "It answers.", deadline, seconds: 20 } };
};
const shown = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 60));

/** Regression: Space, which pauses, rolled back what another browser had written. */
test("a change of another page takes no focus in any of its states, and ends here with its end", async () => {
  const page = await openConfigure("xbus");
  for (const start of [document.body, (await until("select")) as HTMLElement]) {
    start.focus();
    for (const state of STATES) {
      page.tell(rollback(state));
      await shown();
      const isOver = state === "confirmed" || state === "rolled-back";
      expect([state, document.querySelector(".pending-rollback") === null]).toEqual([state, isOver]);
      expect([state, document.activeElement]).toEqual([state, start === document.body ? document.body : start]);
    }
    page.tell({ pending_rollback: null });
  }
});

test("the page that wrote has the focus on the banner, not on a button, and not while someone types", async () => {
  const page = await openConfigure("xbus");
  configureOf(page.app).wrote("1");
  page.tell(rollback("pending"));
  await waitFor(() => expect(document.activeElement).toBe(find(".pending-rollback[role=alertdialog]")));
  page.tell(rollback("confirmed"));
  await waitFor(() => expect(find(".pending-rollback").textContent).toContain("Confirmed"));
  const field = find("input[type=search]");
  field.focus();
  page.tell(rollback("pending"));
  await until(".pending-rollback[role=alertdialog]");
  await shown();
  expect(document.activeElement).toBe(field);
});

test("a press that was begun before the banner stood under it answers nothing", async () => {
  const page = await openConfigure("xbus", { answers: { "POST /api/devices/1/roll-back": {} } });
  const answered = (): number => page.asked.filter(({ path }) => path.endsWith("/roll-back")).length;
  page.tell(rollback("pending"));
  fireEvent.click(button("Roll back now", await until(".pending-rollback")));
  await shown();
  expect(answered()).toBe(0);
  await waitFor(() => {
    fireEvent.click(button("Roll back now"));
    expect(answered()).toBe(1);
  });
});

/** Regression: two buttons "Stop" stood beside the two that answer; the server refuses them meanwhile. */
test("a change that awaits its confirmation is not offered to be stopped", async () => {
  const page = await openConfigure("xbus");
  page.tell({ running: job(3, { state: "running" }) });
  await waitFor(() => button("Stop"));
  page.tell(rollback("pending"));
  await waitFor(() => expect(() => button("Stop")).toThrow());
});
