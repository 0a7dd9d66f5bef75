// @vitest-environment happy-dom
/** What is in memory is saved as a recording, or exported, for the range in view. */
import { act, fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { RecordingInfo } from "../wire/recording-types";
import { newApp } from "../testing/live-page";
import { answering, type Asked, recorded } from "../testing/recorded";
import { capabilities } from "../wire/capabilities";
import type { ExportCapability } from "../wire/capability-types";
import type { App } from "../page/context";
import { MemoryDialog } from "./memory-dialog";
import { SavedBand } from "./record-button";
import { route } from "../page/route";
import { exportingOf } from "../recordings/exporting";

const NOW = 1_760_000_000;
const SAVED = { id: "yard", devices: ["1"], t0: NOW - 21, t1: NOW + 1, bytes: 44_000 };

function open(held: readonly object[]): { readonly app: App; readonly asked: readonly Asked[]; closed: () => number } {
  const [info] = recorded("library").answers["GET /api/recordings"] as readonly RecordingInfo[];
  capabilities.value = {
    links: [],
    absent: [],
    protocols: [],
    exports: [{ name: "csv", title: "CSV", words: "", single: false, protocol: "" } as unknown as ExportCapability],
  };
  const asked = answering({
    "GET /api/recorder/memory": held,
    "POST /api/recordings/save-memory": SAVED,
    "GET /api/recordings": [{ ...info, id: "yard" }],
  });
  const app = newApp();
  app.viewState.view.value = { ...app.viewState.view.peek(), live: false, end: NOW, span: 20 };
  const close = vi.fn();
  render(<MemoryDialog app={app} onClose={close} />);
  return { app, asked, closed: () => close.mock.calls.length };
}

const HELD = [{ device: "1", t0: NOW - 200, t1: NOW, size: 1_000_000 }];
const body = (asked: readonly Asked[]): unknown => asked.find(({ path }) => path.endsWith("/save-memory"))?.body;

test("what is in view is saved, and shown with its link", async () => {
  const { app, asked, closed } = open(HELD);
  await screen.findByText(/the last 03:20 min are in memory/);
  fireEvent.click(screen.getByRole("button", { name: "Save as recording" }));
  await waitFor(() => expect(closed()).toBe(1));
  expect(body(asked)).toMatchObject({ t0: NOW - 21, t1: NOW + 1, devices: null });
  vi.useFakeTimers();
  route.value = { ...route.peek(), page: "live" }; // an earlier file of this worker may have left another
  render(<SavedBand app={app} />);
  expect(screen.getByRole("link", { name: "Open" }).getAttribute("href")).toContain("yard");
  await act(async () => void (await vi.advanceTimersByTimeAsync(60_000))); // it stood over the plots until somebody closed it
  expect(screen.queryByRole("link", { name: "Open" })).toBeNull();
  vi.useRealTimers();
});

test("an export begins with what is in view", async () => {
  const { app, closed } = open(HELD);
  await screen.findByText(/are in memory/);
  fireEvent.click(screen.getByRole("button", { name: "Export…" }));
  await waitFor(() => expect(closed()).toBe(1));
  expect(exportingOf(app).value?.chosen).toMatchObject({ t0: NOW - 20, t1: NOW });
});

test("the last minute and everything can be saved instead", async () => {
  const { asked, closed } = open(HELD);
  await screen.findByText(/are in memory/);
  fireEvent.click(screen.getByRole("button", { name: "Everything" }));
  fireEvent.click(screen.getByRole("button", { name: "Save as recording" }));
  await waitFor(() => expect(closed()).toBe(1));
  expect(body(asked)).toMatchObject({ t0: null, t1: null });
});

test("a part that is no longer in memory is said, and cannot be saved", async () => {
  open([{ device: "1", t0: NOW + 50, t1: NOW + 90, size: 1000 }]);
  await screen.findByText("The part in view is older than what is in memory.");
  expect((screen.getByRole("button", { name: "Save as recording" }) as HTMLButtonElement).disabled).toBe(true);
});

test("without any bytes the reason is said", async () => {
  open([]);
  await screen.findByText(/^No bytes are in memory/);
});

test("an export from memory saves one recording, however often its button is pressed before its dialog opens", async () => {
  const { app, asked } = open(HELD);
  const button = await screen.findByRole<HTMLButtonElement>("button", { name: /^Export/ });
  await waitFor(() => expect(button.disabled).toBe(false));
  fireEvent.click(button);
  const isAsked = (end: string): boolean => asked.some(({ path }) => path.endsWith(end));
  await waitFor(() => expect(isAsked("/api/recordings")).toBe(true), { interval: 1 });
  expect(button.disabled).toBe(true);
  await waitFor(() => expect(exportingOf(app).value?.info.id).toBe("yard"));
});
