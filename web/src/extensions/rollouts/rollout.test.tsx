// @vitest-environment happy-dom
/** One profile for several devices: what is ticked is written, to the chosen devices, and the result of each is shown. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { CompareRequest, Difference, SnapshotBody } from "../../wire/form-types";
import { openConfigure } from "../../testing/configure-page";
import { recorded } from "../../testing/recorded";
import type { Job } from "../../wire/types";
import "./index";
import { bodiesOf, buttonOf as button, find, job, until } from "../../testing/queries";

const known = recorded("xbus");
const VALUES = known.answers["GET /api/devices/1/values"] as SnapshotBody;

const KEY = "OutputConfiguration/outputs.3";
const TAKEN = { writable: true, take: true, key: KEY, why: "" };

/** A server's comparison: of the rows those are taken that are chosen, or by default all that can be written. */
function comparing(found: Difference) {
  return (_: URLSearchParams, body: unknown): Difference => {
    const { take, take_rest } = body as CompareRequest;
    const rows = found.rows.map((row) => ({ ...row, take: row.writable && (take[row.key] ?? take_rest ?? true) }));
    return { ...found, rows, changes: rows.some((row) => row.take) ? found.profile : {} };
  };
}

test("who may only look has nothing to write a profile with", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const other = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz" };
  const row = { ...other, left: "50 Hz", right: "100 Hz", left_value: 50, right_value: 100, ...TAKEN };
  const difference = { ...(same as Difference), rows: [row], changes: { OutputConfiguration: {} } };
  await openConfigure("xbus", {
    place: "compare/~factory",
    isViewOnly: true,
    answers: { "POST /api/devices/1/compare": difference },
  });
  await waitFor(() => expect(find('.rollout tr[data-device="1"]').textContent).toContain("1 value, ticked above"));
  await waitFor(() => expect(button("Apply this profile").disabled).toBe(true));
});

/** Regression: a profile was written as a whole or not at all. */
test("only the ticked differences are written, and of one without any nothing", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const other = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz" };
  const row = { ...other, left: "50 Hz", right: "100 Hz", left_value: 50, right_value: 100, ...TAKEN };
  const found = { ...(same as Difference), rows: [row], changes: { OutputConfiguration: { outputs: [] } } };
  const answers = { "POST /api/devices/1/compare": found };
  const page = await openConfigure("xbus", { place: "compare/~factory", answers });
  const tick = (await until(".difference-table .tick input")) as HTMLInputElement;
  expect(tick.checked).toBe(true);
  await waitFor(() => expect(button("Apply this profile").disabled).toBe(false));
  const before = bodiesOf(page, "/api/devices/1/compare").length;
  Object.assign(found, { rows: [{ ...row, take: false }], changes: {} });
  fireEvent.click(tick);
  await waitFor(() => expect(find(".rollout").textContent).toContain("no difference is ticked"));
  expect(button("Apply this profile").disabled).toBe(true);
  const bodies = bodiesOf(page, "/api/devices/1/compare").slice(before);
  expect(bodies).toHaveLength(2); // of the table, and of the device that it would be written to
  for (const body of bodies) expect(body).toMatchObject({ take: { [row.key]: false } });
});

/** Regression: until the answer to a tick had come, the button wrote what had been ticked before. */
test("nothing is written by a comparison of other ticks", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const other = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz" };
  const row = { ...other, left: "50 Hz", right: "100 Hz", left_value: 50, right_value: 100, ...TAKEN };
  const found = { ...(same as Difference), rows: [row], changes: { OutputConfiguration: { outputs: [] } } };
  await openConfigure("xbus", { place: "compare/~factory", answers: { "POST /api/devices/1/compare": found } });
  await waitFor(() => expect(button("Apply this profile").disabled).toBe(false));
  vi.stubGlobal("fetch", () => new Promise(() => {}));
  fireEvent.click(find(".difference-table .tick input"));
  await waitFor(() => expect(button("Apply this profile").disabled).toBe(true));
  expect(find(".rollout table").hasAttribute("data-old")).toBe(true);
});

/** Regression: the differences of the selected device were written to all, and only its result was reported. */
test("a profile goes to the chosen device with that device's own differences, and its result is shown", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const equal = same as Difference;
  const row = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz", ...TAKEN };
  const differs = { ...row, left: "100 Hz", right: "50 Hz", left_value: 100, right_value: 50 };
  const gnss = { ...differs, path: "outputs.4", key: "OutputConfiguration/outputs.4", title: "GNSS solution" };
  const profile = { OutputConfiguration: { outputs: [] } };
  const dangers = ["The change is temporary: it is rolled back unless confirmed within 30 s."];
  const unread = { ...VALUES, info: { ...VALUES.info, taken: 0 } };
  let third = unread;
  const page = await openConfigure("xbus", {
    place: "compare/device",
    answers: {
      "POST /api/devices/1/compare": equal,
      "GET /api/devices/2/values": VALUES,
      "GET /api/devices/3/values": () => third,
      "POST /api/devices/2/compare": comparing({ ...equal, rows: [differs, gnss], profile, temporary: true, dangers }),
      "POST /api/devices/3/compare": { ...equal, dangers: ["The profile is of “MTi-680G”."] },
      "POST /api/devices/3/read": job(1, { device: "3", state: "waiting" }),
      "POST /api/devices/xbus-2/apply": job(5, { device: "2", state: "waiting" }),
    },
  });
  const [one] = page.store.devices.value;
  if (one === undefined) throw new Error("no device");
  page.store.receive({
    kind: "text",
    text: {
      op: "devices",
      devices: ["1", "2", "3"].map((id) => ({ ...one, id, serial_number: id, key: `xbus-${id}` })),
    },
  });
  const line = (id: string): HTMLElement => find(`.rollout tr[data-device="${id}"]`);
  fireEvent.click(await waitFor(() => within(line("3")).getByRole("button", { name: /^Read/ })));
  await waitFor(() => expect(bodiesOf(page, "/api/devices/3/read")).toHaveLength(1));
  third = VALUES;
  const idle = { state: "", running: null, queue: [], pending_rollback: null, unfinished: "" };
  const told = (device: string, done: readonly Job[]): void =>
    page.store.receive({ kind: "text", text: { op: "jobs", devices: [{ ...idle, device, done }] } });
  told("3", [job(1, { device: "3" })]);
  await waitFor(() => expect(line("3").textContent).toContain("“MTi-680G”"));
  expect(line("3").textContent).toContain("No change");
  const ofGnss = () => within(line("2")).getByLabelText("GNSS solution: 100 Hz → 50 Hz") as HTMLInputElement;
  expect(line("2").textContent).toContain("0 of 2 values ticked");
  expect(ofGnss().checked).toBe(false);
  expect(button("Apply this profile").disabled).toBe(true);
  const whole = find('.rollout tr[data-device="2"] input') as HTMLInputElement;
  fireEvent.click(whole);
  await waitFor(() => expect(line("2").textContent).toContain("2 of 2 values ticked"));
  fireEvent.click(ofGnss());
  await waitFor(() => expect(line("2").textContent).toContain("1 of 2 values ticked"));
  expect([ofGnss().checked, whole.checked, whole.indeterminate]).toEqual([false, true, true]);
  expect(bodiesOf(page, "/api/devices/2/compare").at(-1)).toMatchObject({ take: { [KEY]: true }, take_rest: false });
  fireEvent.click(button("Apply this profile"));
  const question = within(await screen.findByRole("dialog"));
  const words = `${one.name} · 2: 1 value (Acceleration). The change is temporary: it is rolled back unless confirmed within 30 s.`;
  expect(find("dialog").textContent).toContain(words);
  expect(page.asked.some(({ path }) => path.endsWith("/apply"))).toBe(false);
  fireEvent.click(question.getByRole("button", { name: "Write, then confirm" }));
  const base = { OutputConfiguration: VALUES.values["OutputConfiguration"] };
  await waitFor(() => expect(bodiesOf(page, "/api/devices/xbus-2/apply")).toMatchObject([{ changes: profile, base }]));
  expect(page.asked.filter(({ path }) => path.endsWith("/apply"))).toHaveLength(1);
  told("2", [job(5, { device: "2", message: "1 of 1 settings written and read back." })]);
  await waitFor(() => expect(line("2").textContent).toContain("written and read back"));
  told("2", []); // the server keeps a few jobs only
  page.goTo("compare/snapshot");
  page.goTo("compare/device");
  await waitFor(() => expect(line("2").textContent).toContain("written and read back"));
  page.store.receive({ kind: "subscribed", fresh: true });
  told("2", [job(5, { device: "2", message: "Another job of the same number." })]);
  await waitFor(() => expect(line("2").textContent).toContain("written and read back"));
  expect(line("2").textContent).not.toContain("of the same number");
  fireEvent.click(button("Dismiss results"));
  await waitFor(() => expect(line("2").textContent).not.toContain("written and read back"));
});

/** Regression: what a product lacks was offered with the rest, and refused by the server or the device after the press. */
test("what a product lacks is named, with the reason, and cannot be ticked", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const row = { setting: "OutputConfiguration", path: "outputs.3", title: "GNSS solution", unit: "Hz", left: "off" };
  const absent = { ...row, ...TAKEN, right: "4 Hz", left_value: null, right_value: 4, writable: false, take: false };
  const rows = [{ ...absent, why: "MTi-630 has no GnssPvtData." }];
  const found = { ...(same as Difference), rows, missing: { GnssLeverArm: "no such setting" }, changes: {} };
  const page = await openConfigure("xbus", {
    place: "compare/~factory",
    answers: {
      "POST /api/devices/1/compare": found,
      "GET /api/devices/2/values": VALUES,
      "POST /api/devices/2/compare": found,
    },
  });
  const [one] = page.store.devices.value;
  if (one === undefined) throw new Error("no device");
  const devices = ["1", "2"].map((id) => ({ ...one, id, serial_number: id, key: `xbus-${id}` }));
  page.store.receive({ kind: "text", text: { op: "devices", devices } });
  await waitFor(() => expect(find('.rollout tr[data-device="2"]').textContent).toContain("2 values left out"));
  for (const words of ["GNSS solution: MTi-630 has no GnssPvtData.", "GnssLeverArm: no such setting"])
    expect(find('.rollout tr[data-device="2"]').textContent).toContain(words);
  expect(find(".difference-table").textContent).toContain("MTi-630 has no GnssPvtData.");
  expect(document.querySelectorAll(".difference-table input, .rollout .ticks input")).toHaveLength(0);
  for (const box of document.querySelectorAll<HTMLInputElement>(".rollout tr input")) expect(box.disabled).toBe(true);
});
