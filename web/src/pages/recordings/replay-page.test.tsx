// @vitest-environment happy-dom
/** Opening, reading, seeking, marking and closing a recording, with samples recorded from a server. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { ReplayController } from "../../recordings/replay-controller";
import { type Opened, openPage } from "../../testing/live-page";
import { type Answers, recorded } from "../../testing/recorded";
import { detailOf, recordingAnswers, samplesOf } from "../../testing/recordings";
import { find, press } from "../../testing/queries";

Object.defineProperty(navigator, "webdriver", { value: true }); // the page then shows its controller to tests

const YARD = detailOf("yard");
const ACCELERATION = samplesOf("yard", "1", "Acceleration");
const DURATION = YARD.t1 - YARD.t0;

const text = (selector: string): string => find(selector).textContent ?? "";
const windows = ({ asked }: Opened): readonly URLSearchParams[] =>
  asked.filter(({ path }) => path.includes("/window?")).map(({ path }) => new URLSearchParams(path.split("?")[1]));

/** The first value of the first legend: x of the acceleration. */
const read = (): number => Number(text(".plot .legend .series-value").replace("−", "-"));
/** The last sample sent before a moment. */
function sent(t: number, { n, time, columns } = ACCELERATION): number {
  let k = 0;
  while (k + 1 < n && (time[k + 1] ?? Infinity) <= t + 1e-6) k += 1;
  return Number(columns[0]?.[k]);
}

/** Recorded settings of a device. */
const SNAPSHOT = { values: { LocationID: { locationId: 7 } }, missing: {}, protocol: "xbus", product: "MTi-630" };

/** Samples before and after the playhead are loaded: a step needs them, and a value may come from the plot meanwhile. */
function canStep(replay: ReplayController): void {
  const channel = replay.near.channel("1", "Acceleration");
  if (channel === undefined) throw new Error("no acceleration");
  const { ring } = replay.reads(channel, replay.head);
  expect(ring.length).toBeGreaterThan(1);
  expect(ring.time(0)).toBeLessThan(replay.head);
  expect(ring.time(ring.length - 1)).toBeGreaterThan(replay.head);
}

interface OpenedReplay extends Opened {
  readonly replay: ReplayController;
}

async function open(query = "", answers: Answers = {}): Promise<OpenedReplay> {
  const page = await openPage(
    { ...recorded("recordings"), answers: recordingAnswers() },
    { place: `#/recordings/yard${query}`, answers },
  );
  await waitFor(() => expect(document.querySelector(".replay")).not.toBeNull());
  await waitFor(() => expect(text(".plot .legend .series-value")).toMatch(/\d/));
  const replay = window.imuscopeReplay;
  if (replay === undefined) throw new Error("no recording is open");
  return { ...page, replay };
}

test("a recording opens in full, with the playhead at its start", async () => {
  const page = await open();
  expect(screen.getByRole("heading", { level: 1 }).textContent).toBe("Yard loop");
  const [first] = windows(page);
  expect(Number(first?.get("t0"))).toBeLessThanOrEqual(YARD.t0);
  expect(Number(first?.get("t1"))).toBeGreaterThanOrEqual(YARD.t1);
  expect(page.replay.viewState.view.value).toMatchObject({ device: "1", live: false, end: YARD.t1 });
  await waitFor(() => expect(read()).toBeCloseTo(sent(YARD.t0), 2));
  await waitFor(() => expect(text(".transport .now")).toMatch(/^00:00\.000 \/ 00:0[56]/));
  expect([...document.querySelectorAll(".rail .categories button")].length).toBe(YARD.devices.length);
  expect(page.app.viewState.isLive.value).toBe(true); // Live is unchanged
});

test("before the first frame the panels are as high as they will be: nothing below moves under a pointer", async () => {
  const frames: FrameRequestCallback[] = [];
  vi.stubGlobal("requestAnimationFrame", (draw: FrameRequestCallback) => frames.push(draw));
  const known = { ...recorded("recordings"), answers: recordingAnswers() };
  await openPage(known, { place: "#/recordings/yard" });
  await waitFor(() => find(".lower-panels [data-panel=health]"));
  const row = (name: string): HTMLElement | null | undefined => screen.getByText(name).closest("div");
  expect(row("Last sample")?.hidden).toBe(true); // left out over a recording
  expect(text("[data-panel=health] .verdict")).not.toBe("");
  expect(text("[data-panel=events] .event-list, [data-panel=events] .foot-note")).not.toBe("");
  vi.unstubAllGlobals();
  for (const draw of frames) requestAnimationFrame(draw);
});

test("keys move the playhead, and the values follow", async () => {
  const { replay } = await open();
  press("End");
  expect(replay.head).toBe(YARD.t1);
  await waitFor(() => expect(read()).toBeCloseTo(sent(YARD.t1), 2));
  press("Home");
  expect(replay.head).toBe(YARD.t0);
  replay.seek(YARD.t0 + 2);
  await waitFor(() => expect(read()).toBeCloseTo(sent(YARD.t0 + 2), 2));
  await waitFor(() => canStep(replay));
  const before = replay.head;
  press(".");
  await waitFor(() => expect(replay.head).toBeGreaterThan(before));
  expect(replay.head - before).toBeLessThan(0.02);
  await waitFor(() => expect(read()).toBeCloseTo(sent(replay.head), 2));
  const stepped = replay.head;
  await waitFor(() => canStep(replay));
  press(",");
  await waitFor(() => expect(replay.head).toBeLessThan(stepped));
});

test("a press on the overview moves the playhead, and with Shift sets the loop", async () => {
  const { replay } = await open();
  const strip = find(".overview canvas");
  fireEvent.pointerDown(strip, { clientX: 500, pointerId: 1, button: 0 });
  fireEvent.pointerUp(strip, { clientX: 500, pointerId: 1 });
  const part = (replay.head - YARD.t0) / DURATION;
  expect(part).toBeGreaterThan(0.3);
  expect(part).toBeLessThan(0.7);
  fireEvent.pointerDown(strip, { clientX: 400, pointerId: 1, button: 0, shiftKey: true });
  fireEvent.pointerMove(strip, { clientX: 600, pointerId: 1, shiftKey: true });
  fireEvent.pointerUp(strip, { clientX: 600, pointerId: 1, shiftKey: true });
  const [a, b] = replay.loop.value ?? [NaN, NaN];
  expect(b - a).toBeGreaterThan(0.1 * DURATION);
  expect(a).toBeLessThan(replay.head);
  expect(replay.looping.value).toBe(true);
  await waitFor(() => expect(screen.getByRole("button", { name: /^Loop/ }).textContent).toMatch(/00:0/));
});

test("a range selected on the plots is shown, and the whole again", async () => {
  const { replay } = await open();
  const { view } = replay.viewState;
  const on = find(".plot canvas");
  fireEvent.pointerDown(on, { clientX: 450, pointerId: 1, button: 0, shiftKey: true });
  fireEvent.pointerMove(on, { clientX: 550, pointerId: 1, shiftKey: true });
  fireEvent.pointerUp(on, { clientX: 550, pointerId: 1, shiftKey: true });
  expect(view.value.span).toBeLessThan(0.2 * DURATION);
  expect(view.value.end).toBeLessThan(YARD.t1);
  expect(replay.head).toBe(YARD.t0); // only the window moved
  await waitFor(() => expect(replay.isShown).toBe(true));
  const link = (): URLSearchParams => new URLSearchParams(location.hash.split("?")[1]);
  await waitFor(() => expect(Number(link().get("t1"))).toBeCloseTo(view.value.end, 3));
  press("f");
  expect(view.value.span).toBeGreaterThanOrEqual(DURATION);
});

test("it plays by a key, at the chosen speed, and loops the visible range", async () => {
  const { replay } = await open();
  fireEvent.change(screen.getByRole("combobox", { name: "Speed" }), { target: { value: "10" } });
  press(" ", { code: "Space" });
  expect(replay.playing.value).toBe(true);
  await waitFor(() => expect(replay.head).toBe(YARD.t1)); // its end
  await waitFor(() => expect(replay.playing.value).toBe(false));
  replay.viewState.actions.select(YARD.t0 + 1, YARD.t0 + 2);
  press("l");
  expect(replay.loop.value?.map((t) => t - YARD.t0)).toEqual([expect.closeTo(1, 3), expect.closeTo(2, 3)]);
  replay.seek(YARD.t0 + 1.9);
  press(" ", { code: "Space" });
  await waitFor(() => expect(replay.head).toBeLessThan(YARD.t0 + 1.9)); // it restarted
  expect(replay.head).toBeGreaterThanOrEqual(YARD.t0 + 1);
  press(" ", { code: "Space" });
  expect(replay.playing.value).toBe(false);
});

test("a marker is set at the playhead, and a press moves to it", async () => {
  const { replay, asked } = await open();
  const list = within(screen.getByRole("region", { name: "Markers" }));
  expect(list.getAllByRole("listitem").map(({ textContent }) => textContent)).toEqual([
    expect.stringContaining("kerb"),
  ]);
  replay.seek(YARD.t0 + 1.5);
  press("m");
  const field = await screen.findByPlaceholderText<HTMLInputElement>(/^Marker at 00:01\.500/);
  expect(document.activeElement).toBe(field);
  fireEvent.input(field, { target: { value: "second look" } });
  fireEvent.submit(field.form as HTMLFormElement);
  await waitFor(() => expect(list.getAllByRole("listitem").length).toBe(2));
  expect(asked.find(({ method }) => method === "POST")).toMatchObject({
    path: "/api/recordings/yard/markers",
    body: { text: "second look", kind: "marker", time: replay.head },
  });
  fireEvent.click(list.getByText("kerb"));
  expect(replay.head).toBe(YARD.markers[0]?.time);
  fireEvent.click(list.getByText("second look"));
  expect(replay.head).toBeCloseTo(YARD.t0 + 1.5, 3);
});

test("another device is shown at the same moment", async () => {
  const { replay } = await open();
  replay.seek(YARD.t0 + 2);
  const [, second] = document.querySelectorAll(".rail .categories button");
  if (second === undefined) throw new Error("no second device");
  fireEvent.click(second);
  await waitFor(() => expect(second.getAttribute("aria-pressed")).toBe("true"));
  expect(replay.head).toBe(YARD.t0 + 2);
  const other = samplesOf("yard", "2", "DID_IMU.I.acc");
  await waitFor(() => expect(read()).toBeCloseTo(sent(replay.head, other), 2));
});

test("a link with a position opens that position", async () => {
  const { t0 } = YARD;
  const place = `t0=${t0 + 1}&t1=${t0 + 2}&cursor=${t0 + 1.25}&device=1&base=arrival&hide=Acceleration.y`;
  const { replay } = await open(`?${place}`);
  const { view, hiddenSeries } = replay.viewState;
  expect(view.value).toMatchObject({ timeBase: "arrival", end: expect.closeTo(t0 + 2, 3), span: expect.closeTo(1, 3) });
  expect(replay.head).toBeCloseTo(t0 + 1.25, 3);
  expect([...hiddenSeries.value]).toContain("Acceleration.y");
  const [, y] = document.querySelectorAll(".plot .legend button");
  expect(y?.getAttribute("aria-pressed")).toBe("false");
  press("2", { code: "Digit2" });
  expect(y?.getAttribute("aria-pressed")).toBe("true");
});

test("a closed recording makes no requests and handles no keys", async () => {
  const page = await open();
  const { replay, asked } = page;
  location.hash = "#/recordings";
  dispatchEvent(new HashChangeEvent("hashchange"));
  await waitFor(() => expect(document.querySelectorAll(".recording-list tbody tr").length).toBe(2));
  expect(document.querySelector(".replay")).toBeNull();
  expect(window.imuscopeReplay).toBeUndefined();
  const samples = asked.filter(({ path }) => /\/(window|health)\?/.test(path));
  expect(samples.length).toBeGreaterThan(2);
  expect(samples.filter(({ signal }) => signal?.aborted !== true)).toEqual([]); // those under way are cancelled
  const windowsBefore = windows(page).length;
  press(" ", { code: "Space" });
  expect(replay.playing.value).toBe(false);
  replay.viewState.actions.select(YARD.t0 + 1, YARD.t0 + 1.1);
  fireEvent.click(screen.getByText("Harbour"));
  await waitFor(() => expect(text(".detail")).toContain("Length"));
  expect(windows(page).length).toBe(windowsBefore);
  expect(asked.some(({ method }) => method === "POST")).toBe(false);
});

test("while it is decoded its progress is shown, then the recording", async () => {
  const states = [0.25, 0.75];
  const answers = {
    "GET /api/recordings/yard": () => {
      const progress = states.shift();
      if (progress === undefined) return YARD;
      return { id: "yard", progress, message: "Decoding the recording for the first time." };
    },
  };
  const opening = open("", answers);
  await waitFor(() => expect(screen.getByRole("progressbar").getAttribute("aria-label")).toContain("25"));
  expect(text(".opening")).toContain("Decoding the recording for the first time.");
  await opening;
  expect(document.querySelector(".opening")).toBeNull();
});

test("decoded data are shown at once, and the rest is added without moving the view", async () => {
  let isDecoded = false;
  const { t0, t1 } = YARD;
  const part = { ...YARD, t1: t0 + 3, progress: 0.5, markers: [], snapshots: { "1": SNAPSHOT } };
  const whole = { ...YARD, snapshots: part.snapshots };
  await open("", { "GET /api/recordings/yard": () => (isDecoded ? whole : part) });
  const replay = (): ReplayController => window.imuscopeReplay as ReplayController;
  expect(replay().bounds.last).toBe(t0 + 3);
  expect(screen.getByRole("progressbar", { name: /decod/i })).toBeTruthy();
  replay().viewState.actions.select(t0 + 1, t0 + 2);
  replay().seek(t0 + 1.5);
  fireEvent.click(screen.getByRole("button", { name: "As recorded" }));
  await screen.findByRole("dialog");
  isDecoded = true;
  await waitFor(() => expect(replay().bounds.last).toBe(t1));
  expect(replay().head).toBe(t0 + 1.5);
  expect(replay().viewState.view.value).toMatchObject({ end: expect.closeTo(t0 + 2, 6), span: expect.closeTo(1, 6) });
  await waitFor(() => expect(screen.queryByRole("progressbar", { name: /decod/i })).toBeNull());
  await screen.findByRole("dialog"); // it has stayed open
  expect(text(".markers")).toContain("kerb");
});

test("the export covers the loop, the window or everything", async () => {
  const { replay } = await open();
  const { first } = replay.bounds;
  replay.viewState.actions.select(first + 1, first + 3);
  replay.toggleLoop();
  replay.viewState.actions.select(first + 2, first + 4);
  fireEvent.click(screen.getByRole("button", { name: "Export…" }));
  const dialog = within(await screen.findByRole("dialog"));
  const words = (): string => text("dialog p");
  fireEvent.click(dialog.getByRole("button", { name: "Loop range" }));
  await waitFor(() => expect(words()).toMatch(/00:01.* to 00:03/));
  fireEvent.click(dialog.getByRole("button", { name: "In view" }));
  await waitFor(() => expect(words()).toMatch(/00:02.* to 00:04/));
  press(" ", { code: "Space" });
  expect(replay.playing.value).toBe(false); // its keys are inactive under the dialog
  fireEvent.click(dialog.getByRole("button", { name: "Close" }));
  await waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
});

test("the health figures are those of the playhead", async () => {
  const { replay } = await open();
  replay.seek(YARD.t0 + 4);
  const health = () => replay.near.health.value.get("1");
  await waitFor(() => expect(health()?.bytes_per_s).toBeGreaterThan(0));
  expect(health()?.time).toBeCloseTo(YARD.t0 + 4, 0);
  expect(health()?.rate).toBeGreaterThan(90);
  await waitFor(() => expect(text(".side")).toMatch(/[1-9][0-9.]*\s*kB/));
});

test("a recording that cannot be opened shows the reason and a link back", async () => {
  const known = recorded("recordings");
  await openPage(known, { place: "#/recordings/nowhere" });
  await waitFor(() => expect(text("main")).toContain("Nothing was recorded of /api/recordings/nowhere"));
  expect(screen.getByRole("link", { name: /library/i }).getAttribute("href")).toBe("#/recordings");
});

test("the range between the cursors, else the one in view, becomes a recording that can be opened", async () => {
  const kept = { ...YARD.info, id: "kerb", title: "Kerb" };
  const { replay, asked } = await open("", { "POST /api/recordings/yard/keep": kept });
  const { view, cursor, measure } = replay.viewState;
  view.value = { ...view.peek(), end: YARD.t0 + 4, span: 3 };
  fireEvent.click(screen.getByRole("button", { name: "Keep this range" }));
  await waitFor(() => expect(screen.getByRole("link", { name: "Open" }).getAttribute("href")).toContain("kerb"));
  cursor.value = { kind: "pinned", time: YARD.t0 + 3 };
  measure.value = YARD.t0 + 2;
  fireEvent.click(await screen.findByRole("button", { name: "Keep A to B" }));
  await waitFor(() => expect(asked.filter(({ path }) => path.endsWith("/keep")).length).toBe(2));
  const bodies = asked.filter(({ path }) => path.endsWith("/keep")).map(({ body }) => body);
  expect(bodies[0]).toMatchObject({ t0: YARD.t0 + 1, t1: YARD.t0 + 4, title: "Yard loop, 00:01.0 to 00:04.0" });
  expect(bodies[1]).toMatchObject({ t0: YARD.t0 + 2, t1: YARD.t0 + 3, base: "device" });
});

test("a phone has the name of the recording, and the choice of device beside it", async () => {
  const { replay } = await open();
  const head = find(".replay-head");
  expect(head.textContent).toContain("Yard loop");
  const choice = within(head).getByRole("combobox", { name: "Device on screen" });
  const other = YARD.devices.find(({ id }) => id !== replay.viewState.device.peek());
  fireEvent.change(choice, { target: { value: other?.id } });
  expect(replay.viewState.device.value).toBe(other?.id);
});
