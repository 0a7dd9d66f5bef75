// @vitest-environment happy-dom
import { act, fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../testing/live-page";
import { localNow } from "../wire/clock";
import { type Family, recorded, type Scene } from "../testing/recorded";

const texts = (selector: string): readonly string[] =>
  [...document.querySelectorAll(selector)].map((element) => element.textContent?.trim() ?? "");
const text = (selector: string): string => texts(selector)[0] ?? "";
const number = (words: string): number => Number(words.replace("−", "-").replace(/[\u2009°]/g, ""));
const numeral = (name: string): number => number(text(`[data-numeral=${name}]`));
const open = (name: Family | Scene, options?: Parameters<typeof openPage>[1]): Promise<Opened> =>
  openPage(recorded(name), options);

test.each([
  ["attitude-ins-1", "NED", "from INS 1", 12],
  ["attitude-ins-2", "NED", "from INS 2", 12],
  ["attitude-ins-4", "NED", "from INS 4", 12],
  ["attitude-imu-quat", "ENU", "from quaternion", -12],
] as const)("the attitude of %s is the one that was sent", async (name, frame, source, pitch) => {
  await open(name);
  await waitFor(() => expect(Math.abs(numeral("heading") - 70)).toBeLessThan(0.06));
  expect(Math.abs(numeral("roll") - 20)).toBeLessThan(0.06);
  expect(Math.abs(numeral("pitch") - pitch)).toBeLessThan(0.06);
  expect(document.querySelectorAll("[data-numeral]").length).toBe(3);
  expect(text(".numerals .segmented [aria-pressed=true]")).toBe(frame);
  expect(text(".numerals .from")).toBe(`now, ${source}`);
});

test("a double click begins a recording, and does not end it", async () => {
  const { store, asked } = await open("xbus", { answers: { "POST /api/recordings/start": {} } });
  const state = {
    title: "",
    devices: [],
    bytes: 0,
    behind_s: 0,
    free: null,
    seconds_left: null,
    headless: [],
    message: "",
    hint: "",
  };
  const tell = (running: boolean): void => {
    const text = { op: "recorder", ...state, running, id: "yard", started: running ? 100 : null } as const;
    void act(() => store.receive({ kind: "text", text }));
  };
  tell(false);
  const sent = (): readonly string[] => asked.flatMap(({ method, path }) => (method === "POST" ? [path] : []));
  fireEvent.click(await screen.findByRole("button", { name: "Record" }), { detail: 1 });
  await waitFor(() => expect(sent()).toEqual(["/api/recordings/start"]));
  tell(true);
  fireEvent.click(await screen.findByRole("button", { name: /^Stop recording/ }), { detail: 2 });
  expect(sent()).toEqual(["/api/recordings/start"]);
});

test("status without set-up", async () => {
  await open("isb");
  const lanes = (): readonly string[] => texts(".lane-names button");
  await waitFor(() => expect(lanes()).toContain("Solution"));
  expect(lanes().some((name) => name.includes("Fix"))).toBe(true);
  expect(lanes().length).toBeLessThan(15);
  const before = lanes().length;
  fireEvent.click(screen.getByRole("button", { name: /more lane/ }));
  expect(lanes().length).toBeGreaterThan(before);
  fireEvent.click(screen.getByRole("button", { name: "Fewer lanes" }));
  expect(texts(".legend b").at(-1)).toContain("Velocity");
  const group = [...document.querySelectorAll(".more-quantities details")].find((one) =>
    one.textContent?.startsWith("GPS1 position"),
  );
  const button = [...(group?.querySelectorAll("button") ?? [])].find((one) =>
    one.textContent?.startsWith("Height above sea level"),
  );
  if (button === undefined) throw new Error("no height is offered");
  fireEvent.click(button);
  await waitFor(() => expect(texts(".legend b").some((name) => name.startsWith("Height above"))).toBe(true));
});

test("unverified data are marked wherever they are", async () => {
  await open("unverified");
  await waitFor(() => expect(document.querySelector(".device .trust[data-trust=unverified]")).not.toBeNull());
  expect(document.querySelectorAll("[data-key=wanted]").length).toBe(1);
  await waitFor(() => expect(texts(".values-table tr.group-row").length).toBeGreaterThan(0));
  expect(texts(".legend b").length).toBeGreaterThan(0);
  expect(texts(".legend b").filter((words) => !words.includes("▲"))).toEqual([]);
  expect(texts(".values-table tr.group-row").filter((words) => !words.includes("▲ unverified"))).toEqual([]);
  await waitFor(() => expect(text(".numerals .trust-mark")).toBe("▲ unverified"));
  await waitFor(() => expect(text(".health-list")).toMatch(/unverified\s*▲/));
});

test("a simulated device is said to be one beside it and in the bar", async () => {
  const { store } = await open("xbus");
  const told = (): readonly number[] =>
    [".device .simulated", ".bar .simulated"].map((place) => document.querySelectorAll(place).length);
  expect(told()).toEqual([1, 1]);
  const devices = store.devices.value.map((one) => ({ ...one, simulated: false }));
  store.receive({ kind: "text", text: { op: "devices", devices } });
  await waitFor(() => expect(told()).toEqual([0, 0]));
});

test("devices that share a link are selected one by one", async () => {
  const { store, app, asked } = await open("shared-link");
  await waitFor(() => expect(document.querySelectorAll(".device .choose-device").length).toBe(3));
  expect([...texts(".device-list .device b")].sort()).toEqual(["IDTP device 102", "IDTP device 7", "IDTP device 9"]);
  expect(document.querySelectorAll(".device.sibling").length).toBe(2);
  for (const [name, protection, rate] of [
    ["IDTP device 7", "verified", 100],
    ["IDTP device 102", "not protected", 50],
  ] as const) {
    fireEvent.click(screen.getByText(name, { selector: ".choose-device b" }));
    await waitFor(() => expect(text(".trust-mark")).toContain(protection));
    await waitFor(() => expect(text("[data-numeral=heading]")).toMatch(/\d/));
    const { device } = app.viewState.view.value;
    expect(Math.abs((store.health.value.get(device ?? "")?.rate ?? 0) - rate)).toBeLessThan(8);
  }
  const { device } = app.viewState.view.value;
  const own = store.channels.value.filter(({ info }) => info.device === device).map(({ info }) => info.name);
  expect(own.length).toBe(new Set(own).size);
  expect(own.length).toBeGreaterThan(0);
  fireEvent.click(screen.getByRole("button", { name: "Remove link" }));
  expect(text(".actions")).toContain("all 3 devices");
  fireEvent.click(screen.getByRole("button", { name: "Remove" }));
  expect(asked.filter(({ method }) => method === "DELETE").map(({ path }) => path)).toEqual(["/api/devices/1"]);
  await act(() => store.receive({ kind: "text", text: { op: "devices", devices: [] } }));
  await waitFor(() => expect(document.querySelectorAll(".device .choose-device").length).toBe(0));
});

test("a lost device is named as such where it is listed", async () => {
  const { store } = await open("xbus");
  await waitFor(() => expect(document.querySelector(".device .choose-device")).not.toBeNull());
  expect(document.querySelector(".device .why .tag.bad")).toBeNull();
  const devices = store.devices.value.map((one) => ({ ...one, status: "lost" as const, is_open: false }));
  store.receive({ kind: "text", text: { op: "devices", devices } });
  await waitFor(() => expect(text(".device .why .tag.bad")).toMatch(/lost/i));
});

test("a notice of the link is shown on the page", async () => {
  await open("two-senders");
  await waitFor(() => expect(text(".notice")).toMatch(/127\.0\.0\.1:\d+ and 127\.0\.0\.1:\d+/));
});

test("without a device the page shows a hint", async () => {
  const { store } = await open("xbus");
  await act(() => store.receive({ kind: "text", text: { op: "devices", devices: [] } }));
  await waitFor(() => expect(text("main")).toContain("No device"));
});

test.each([
  ["1", "connect"],
  ["2", "ttyNOTHERE"],
])("what a device waits for is told: %s", async (device, words) => {
  const page = await open("waiting");
  await act(() => page.look(device));
  await waitFor(() => expect(text("main").toLowerCase()).toContain(words.toLowerCase()));
});

test("a port that may not be opened names its group and what to type, and is tried again at a press", async () => {
  const words = "No permission to open /dev/ttyUSB0: it belongs to the group dialout.";
  const hint = "Run `sudo usermod -aG dialout $USER`, then log out and in again.";
  const { store, asked } = await open("xbus", { answers: { "POST /api/devices/1/retry": {} } });
  const [device] = store.devices.value;
  if (device === undefined) throw new Error("no device");
  const denied = { ...device, status: "denied", message: words, hint } as const;
  await act(() => store.receive({ kind: "text", text: { op: "devices", devices: [denied] } }));
  await waitFor(() => expect(text("main")).toContain(words));
  expect(texts("main code")).toContain("sudo usermod -aG dialout $USER");
  fireEvent.click(screen.getAllByRole("button", { name: "Try now" }).at(-1) as HTMLElement);
  await waitFor(() =>
    expect(asked.some(({ method, path }) => method === "POST" && path === "/api/devices/1/retry")).toBe(true),
  );
});

test("a device that is behind is told beside it, at Live, in Health, and dimmed", async () => {
  const { store, app } = await open("xbus");
  const id = app.device.value?.id ?? "";
  const health = store.health.value.get(id);
  if (health === undefined) throw new Error("no health was recorded");
  const newest = Math.max(...store.channels.value.map(({ ring }) => ring.time(ring.length - 1)));
  store.receive({ kind: "clock", offset: newest + 60 - localNow(), uncertainty: 0.001 });
  const tell = (decoding: number): void =>
    store.receive({
      kind: "text",
      text: { op: "health", devices: [{ ...health, behind: { link: 0, decoding, reason: "others" } }] },
    });
  await act(() => tell(12));
  expect(texts(".device-list .why")).toEqual(["12 s behindthe server's computer is busy"]);
  const live = await screen.findByRole("button", { name: "Live, 12 s behind" });
  expect(live.querySelector(".dot.live")).toBeNull();
  await waitFor(() => expect(text(".note.verdict")).toContain("Behind by 12 s: the server's computer is busy"));
  await waitFor(() => expect(text(".strip .tag.warn:not([hidden])")).toContain("Behind by 12 s")); // on a phone
  expect(document.querySelector(".strip > .tag.warn ~ *"), "it moved the figures under a finger").toBeNull();
  expect(app.held()).toBe(true);
  expect(store.edgeOf(id), "no empty future").toBe(newest);
  await act(() => tell(0.2));
  expect(texts(".device-list .why").join()).not.toContain("behind");
  expect(app.held()).toBe(false);
  expect(store.edgeOf(id)).toBeGreaterThan(newest);
});
