// @vitest-environment happy-dom
/** One profile for several devices: what is ticked is written, to the chosen devices, and the result of each is shown. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import type { Difference, SnapshotBody } from "../../forms/types";
import { openConfigure } from "../../testing/configure-page";
import { recorded } from "../../testing/recorded";
import type { Job } from "../../wire/types";
import "./index";
import { bodiesOf, buttonOf as button, find, job, until } from "../../testing/queries";

const known = recorded("xbus");
const VALUES = known.answers["GET /api/devices/1/values"] as SnapshotBody;

const TAKEN = { writable: true, take: true, key: "OutputConfiguration/outputs.3" };

test("who may only look has nothing to write a profile with", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const other = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz" };
  const row = { ...other, left: "50 Hz", right: "100 Hz", left_value: 50, right_value: 100, ...TAKEN };
  const difference = { ...(same as Difference), rows: [row], changes: { OutputConfiguration: {} } };
  await openConfigure("xbus", {
    place: "compare/~factory",
    answers: { "GET /api/build": { role: "view" }, "POST /api/devices/1/compare": difference },
  });
  await until('.rollout tr[data-device="1"] summary');
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

/** Regression: the differences of the selected device were written to all, and only its result was reported. */
test("a profile goes to the chosen device with that device's own differences, and its result is shown", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const equal = same as Difference;
  const row = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz", ...TAKEN };
  const differs = { ...row, left: "100 Hz", right: "50 Hz", left_value: 100, right_value: 50 };
  const profile = { OutputConfiguration: { outputs: [] } };
  const unread = { ...VALUES, info: { ...VALUES.info, taken: 0 } };
  let third = unread;
  const page = await openConfigure("xbus", {
    place: "compare/device",
    answers: {
      "POST /api/devices/1/compare": equal,
      "GET /api/devices/2/values": VALUES,
      "GET /api/devices/3/values": () => third,
      "POST /api/devices/2/compare": { ...equal, rows: [differs], changes: profile, profile },
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
  expect(within(line("2")).getByText("Acceleration: 100 Hz → 50 Hz")).toBeTruthy();
  expect(button("Apply this profile").disabled).toBe(true);
  fireEvent.click(find('.rollout tr[data-device="2"] input'));
  fireEvent.click(button("Apply this profile"));
  const question = within(await screen.findByRole("dialog"));
  expect(question.getByText(`${one.name} · 2: 1 value.`)).toBeTruthy();
  expect(page.asked.some(({ path }) => path.endsWith("/apply"))).toBe(false);
  fireEvent.click(question.getByRole("button", { name: "Write profile" }));
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
