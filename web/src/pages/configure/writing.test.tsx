// @vitest-environment happy-dom
/** What is written to devices: asked before, refused, changed by others meanwhile, and taken back. */
import { fireEvent, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { Difference, PreviewResult, SnapshotBody } from "../../wire/form-types";
import { openConfigure } from "../../testing/configure-page";
import { recorded } from "../../testing/recorded";
import type { DeviceInfo } from "../../wire/types";
import { configureOf } from "./view-state";
import { bodiesOf, buttonOf as button, find, job, until } from "../../testing/queries";

const ROW = 'tr[data-id="0x4020"] select';
const choose = (field: HTMLElement, value: string): void => void fireEvent.change(field, { target: { value } });

const known = recorded("xbus");
const VALUES = known.answers["GET /api/devices/1/values"] as SnapshotBody;

/** The device's values with another rate of an output. */
function withRate(id: number, rate: number): SnapshotBody {
  const { outputs } = VALUES.values["OutputConfiguration"] as { outputs: Record<string, unknown>[] };
  const changed = outputs.map((one) => (one["data_identifier"] === id ? { ...one, output_frequency: rate } : one));
  return { ...VALUES, values: { ...VALUES.values, OutputConfiguration: { outputs: changed } } };
}

test("a refused value is reported, and the edit is still there to be made again", async () => {
  const page = await openConfigure("xbus", { answers: { "POST /api/devices/1/apply": job(7, { state: "waiting" }) } });
  choose(await until(ROW), "50");
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  fireEvent.click(button("Apply"));
  await waitFor(() => expect(bodiesOf(page, "/api/devices/1/apply")).toHaveLength(1));
  const lost = { setting: "OutputConfiguration", path: "", title: "Output configuration", requested: "", actual: "" };
  page.tell({ done: [job(7, { outcomes: [{ ...lost, reason: "no answer" }] })] });
  expect((await until(".outcomes li")).textContent).toContain("Output configuration");
  expect(find(".outcomes li").textContent).toContain("no answer");
  fireEvent.click(button("Edit again"));
  await waitFor(() => expect(find(".apply-bar").textContent).toContain("1 change"));
});

/** Regression: the confirmation did not mention that the change is temporary, and its button read "Write". */
test("a change applied before its preview has arrived is still reported as temporary", async () => {
  const [, preview] = Object.entries(known.answers).find(([key]) => key.includes('"PortConfig"')) ?? [];
  const line = "The device will answer at 921 600 Bd.";
  const harm = { kind: "confirm", message: line, hint: "" };
  const page = await openConfigure("xbus", {
    place: "PortConfig",
    slow: "/preview",
    answers: {
      "POST /api/devices/1/preview": { ...(preview as PreviewResult), line },
      "POST /api/devices/1/apply": () => Response.json(harm, { status: 409 }),
    },
  });
  const rate = (await until("[data-field=words] select")) as HTMLSelectElement;
  choose(rate, [...rate.options].find((one) => one.textContent === "921 600 Bd")?.value ?? "");
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  fireEvent.click(button("Apply"));
  const dialog = await until("dialog");
  await waitFor(() => expect(document.activeElement?.textContent === "Leave unchanged").toBe(true));
  expect(dialog.textContent).toContain(line);
  fireEvent.click(button("Write, then confirm", dialog));
  await waitFor(() =>
    expect(bodiesOf(page, "/api/devices/1/apply")).toMatchObject([{ confirmed: false }, { confirmed: true }]),
  );
});

test("a change that was confirmed says so, and one that was rolled back says what there is again", async () => {
  const page = await openConfigure("xbus");
  configureOf(page.app).wrote("1");
  const words = "The device answers at 921 600 Bd.";
  const pending = { device: "1", changes: [], words, deadline: 0, seconds: 20 };
  page.tell({ pending_rollback: { ...pending, state: "applying" } });
  await waitFor(() => expect(document.querySelector(".pending-rollback")).not.toBeNull());
  page.tell({ pending_rollback: { ...pending, state: "confirmed" } });
  await waitFor(() => expect(find(".pending-rollback h3").textContent).toMatch(/Confirmed$/));
  page.tell({ pending_rollback: { ...pending, state: "rolled-back" } });
  await waitFor(() => expect(find(".pending-rollback").textContent).toContain("previous settings"));
});

/** Regression: one change became three, which undid the other person's without a word. */
test("a change by others is shown, and the own edit stays the only one", async () => {
  let now = VALUES;
  const page = await openConfigure("xbus", { answers: { "GET /api/devices/1/values": () => now } });
  choose(await until(ROW), "50");
  await waitFor(() => expect(find(".apply-bar").textContent).toContain("1 change"));
  now = withRate(0x2010, 20);
  page.tell({ done: [job(9)] });
  await waitFor(() => expect(find(".band").textContent).toContain("Changed elsewhere"));
  expect(find(".band").textContent).toContain("Quaternion: 100 Hz → 20 Hz");
  expect(find(".apply-bar").textContent).toContain("1 change");
  expect((find(ROW) as HTMLSelectElement).value).toBe("50");
  const other = document.querySelector<HTMLSelectElement>('tr[data-id="0x2010"] select');
  expect(other?.value).toBe("20");
});

/** Regression: a silent device was treated as unreachable, Apply stayed disabled, and the form showed streams as on. */
test("streams that were stopped are shown as off, and can be switched on again in the silence", async () => {
  const isb = recorded("isb");
  const before = isb.answers["GET /api/devices/1/values"] as SnapshotBody;
  let now = before;
  const page = await openConfigure("isb", {
    place: "streams",
    answers: { "GET /api/devices/1/values": () => now, "POST /api/devices/1/apply": job(4, { state: "waiting" }) },
  });
  const tick = (): HTMLInputElement => find('tr[data-id="4"] input') as HTMLInputElement;
  await waitFor(() => expect(tick().checked).toBe(true));
  expect(find(".rail").textContent).not.toContain("Factory default"); // no document tells them
  now = { ...before, values: { ...before.values, streams: { streams: [] } } };
  page.tell({ done: [job(3)] });
  const silent = page.store.devices.value.map((one): DeviceInfo => ({ ...one, status: "lost", is_open: true }));
  page.store.receive({ kind: "text", text: { op: "devices", devices: silent } });
  await waitFor(() => expect(tick().checked).toBe(false));
  fireEvent.click(tick());
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  fireEvent.click(button("Apply"));
  await waitFor(() =>
    expect(bodiesOf(page, "/api/devices/1/apply")).toMatchObject([{ changes: { streams: { streams: [{ did: 4 }] } } }]),
  );
});

const TAKEN = { writable: true, take: true, key: "OutputConfiguration/outputs.3" };

test("who may only look sees bytes, load and differences, and nothing to write them with", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  const other = { setting: "OutputConfiguration", path: "outputs.3", title: "Acceleration", unit: "Hz" };
  const row = { ...other, left: "50 Hz", right: "100 Hz", left_value: 50, right_value: 100, ...TAKEN };
  const difference = { ...(same as Difference), rows: [row], changes: { OutputConfiguration: {} } };
  const page = await openConfigure("xbus", {
    isViewOnly: true,
    answers: { "POST /api/devices/1/compare": difference },
  });
  await until(".budget-bar");
  await waitFor(() => expect(document.querySelectorAll(".hex-part").length).toBeGreaterThan(5));
  page.goTo("compare/~factory");
  const cells = await waitFor(() => {
    const [shown] = document.querySelectorAll(".difference-table tbody tr");
    if (shown === undefined) throw new Error("no difference");
    return [...shown.querySelectorAll("td")].map((cell) => cell.textContent);
  });
  expect(cells).toEqual(["50 Hz", "100 Hz"]);
});

test("a key leads to the search, Enter to what was found, and Escape away from it", async () => {
  await openConfigure("xbus");
  fireEvent.keyDown(document.body, { key: "/" });
  const search = await waitFor(() => {
    const found = document.activeElement as HTMLInputElement;
    expect(found.type).toBe("search");
    return found;
  });
  fireEvent.input(search, { target: { value: "baud" } });
  await until(".categories.found a");
  fireEvent.keyDown(search, { key: "Enter" });
  expect(location.hash.split("/").length).toBeGreaterThanOrEqual(4);
  fireEvent.keyDown(search, { key: "Escape" });
  await waitFor(() => expect(document.querySelector(".found")).toBeNull());
  expect(document.activeElement).not.toBe(search);
});

test("jobs of a server that was started again are not taken for those of the run before", async () => {
  const page = await openConfigure("xbus", { answers: { "POST /api/devices/1/apply": job(1, { state: "waiting" }) } });
  choose(await until(ROW), "50");
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  fireEvent.click(button("Apply"));
  await waitFor(() => expect(bodiesOf(page, "/api/devices/1/apply")).toHaveLength(1));
  const refused = { setting: "OutputConfiguration", path: "", title: "Outputs", requested: "", actual: "", reason: "" };
  page.tell({ done: [job(1, { outcomes: [refused] })] });
  await until(".outcomes li");
  const devices = [...page.store.jobs.peek().values()].map((one) => ({ ...one, done: [] }));
  page.store.receive({ kind: "subscribed", fresh: true });
  page.store.receive({ kind: "text", text: { op: "jobs", devices } });
  page.tell({ running: job(1, { title: "Read all settings", state: "running" }) });
  await waitFor(() => expect(find(".apply-bar").textContent).toContain("1 change"));
  expect(find(".apply-bar").textContent).not.toContain("Read all settings");
});

test("values that are asked for later stay, whichever answer comes last", async () => {
  const page = await openConfigure("xbus");
  await until(ROW);
  const answered = globalThis.fetch;
  const held: ((values: SnapshotBody) => void)[] = [];
  vi.stubGlobal("fetch", (address: string, init: RequestInit) =>
    address.endsWith("/values")
      ? new Promise((resolve) => held.push((values) => resolve(Response.json(values))))
      : answered(address, init),
  );
  page.tell({ done: [job(8)] });
  page.tell({ done: [job(9)] });
  await waitFor(() => expect(held).toHaveLength(2));
  held[1]?.(withRate(0x4020, 50));
  await waitFor(() => expect((find(ROW) as HTMLSelectElement).value).toBe("50"));
  held[0]?.(withRate(0x4020, 100));
  await new Promise((resolve) => setTimeout(resolve, 50));
  expect((find(ROW) as HTMLSelectElement).value).toBe("50");
});

test("a confirmation that is refused says why where it was given, whatever page is shown", async () => {
  const refusal = { kind: "busy", message: "Another program configures the device.", hint: "" };
  const refused = (): Response => Response.json(refusal, { status: 409 });
  const page = await openConfigure("xbus", { answers: { "POST /api/devices/1/confirm": refused } });
  const [words, deadline] = ["It answers.", page.store.serverNow() + 20];
  page.tell({ pending_rollback: { device: "1", state: "pending", changes: [], words, deadline, seconds: 20 } });
  await until(".pending-rollback");
  await waitFor(() => {
    fireEvent.click(button("Confirm"));
    expect(find(".pending-rollback .problem").textContent).toContain("Another program");
  });
});

test("a comparison that failed while the server was away is made once it is back", async () => {
  const [, same] = Object.entries(known.answers).find(([key]) => key.includes("/compare {")) ?? [];
  let isAway = true;
  const page = await openConfigure("xbus", {
    place: "compare/~factory",
    answers: { "POST /api/devices/1/compare": () => (isAway ? new Response("", { status: 502 }) : same) },
  });
  await waitFor(() => expect(find(".compare [role=alert]").textContent).toContain("502"));
  isAway = false;
  page.store.receive({ kind: "connection", state: "closed", nextTry: undefined });
  page.store.receive({ kind: "connection", state: "open", nextTry: undefined });
  await waitFor(() => expect(find(".compare").textContent).not.toContain("502"));
  await until(".difference-table, .compare [role=status] b");
});
