// @vitest-environment happy-dom
import { fireEvent, render, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openConfigure } from "../../testing/configure-page";
import { newApp } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";
import { ConfigurePage } from "./page";
import { find, until } from "../../testing/queries";
import type { SnapshotBody } from "../../wire/form-types";

const gone = (selector: string): Promise<void> => waitFor(() => expect(document.querySelector(selector)).toBeNull());
const button = (name: string): HTMLButtonElement => screen.getByRole("button", { name });
const type = (field: HTMLElement, value: string): void => void fireEvent.input(field, { target: { value } });
const posts = ({ asked }: Opened, path: string): number =>
  asked.filter((one) => one.method === "POST" && one.path.endsWith(path)).length;

const PAUSE = "Reading the settings of an MTi interrupts its measurement for about a second.";

test("a wrong value is refused at its input", async () => {
  await openConfigure("xbus", { place: "LatLonAlt" });
  const latitude = (await until("[data-field=latitude] input")) as HTMLInputElement;
  const before = latitude.value;
  type(latitude, "95");
  const alert = await until("[data-field=latitude] [role=alert]");
  expect(alert.textContent).toContain("90");
  expect(latitude.getAttribute("aria-invalid")).toBe("true");
  type(latitude, "51.5");
  await gone("[data-field=latitude] [role=alert]");
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  fireEvent.click(button("Undo the last edit"));
  await gone(".apply-bar");
  fireEvent.blur(latitude);
  await waitFor(() => expect((find("[data-field=latitude] input") as HTMLInputElement).value).toBe(before));
});

test("discarding all edits removes invalid text and its marks too", async () => {
  await openConfigure("xbus", { place: "LatLonAlt" });
  const field = (name: string) => find(`[data-field=${name}] input`) as HTMLInputElement;
  await until("[data-field=altitude] input");
  const before = [field("latitude").value, field("altitude").value];
  type(field("altitude"), "77");
  type(field("latitude"), "95");
  await until("[data-field=latitude] [role=alert]");
  fireEvent.click(button("Discard all"));
  await gone("[data-field=latitude] [role=alert]");
  expect([field("latitude").value, field("altitude").value]).toEqual(before);
  expect(field("latitude").getAttribute("aria-invalid")).not.toBe("true");
  await gone(".apply-bar");
});

test("an alignment is edited as angles, turned over, or as its quaternion, in one step each", async () => {
  await openConfigure("xbus", { place: "AlignmentRotation.RotSensor" });
  const inputs = (place: string) => [...document.querySelectorAll<HTMLInputElement>(`${place} input`)];
  const [q0, yaw] = ["[data-field=q0] input", ".angles label:last-child input"];
  const quaternion = () => ["q0", "q1", "q2", "q3"].map((name) => Number(inputs(`[data-field=${name}]`)[0]?.value));
  const angles = () => inputs(".angles").map(({ value }) => Number(value));
  await until(".angles input");
  type(find(yaw), "120");
  await waitFor(() => expect(quaternion()).toEqual([0.5, 0, 0, 0.866]));
  fireEvent.click(button("Upside down"));
  await waitFor(() => expect(quaternion()).toEqual([0, 0.5, 0.866, 0]));
  expect(button("Upside down").getAttribute("aria-pressed")).toBe("true");
  fireEvent.click(button("Undo the last edit"));
  await waitFor(() => expect(quaternion()).toEqual([0.5, 0, 0, 0.866]));
  type(find(q0), "0.9");
  await waitFor(() => expect(find(".angles figcaption").textContent).toMatch(/^These numbers are no rotation/));
  fireEvent.click(button("Discard all"));
  await gone(".apply-bar");
  await waitFor(() => expect(angles()).toEqual([0, 0, 0]));
});

test("angles that the device stores have a picture and can be turned over, too", async () => {
  await openConfigure("isb", { place: "DID_FLASH_CONFIG" });
  await until("[data-field=insRotation] canvas");
  fireEvent.click(find("[data-field=insRotation] .segmented button:last-child"));
  const roll = () => (find("[data-field=insRotation] input") as HTMLInputElement).value;
  await waitFor(() => expect(roll()).toBe("180"));
});

test("a load above the capacity is not written, and rates can be fitted", async () => {
  await openConfigure("xbus");
  const rate = (await until('tr[data-id="0x4020"] select')) as HTMLSelectElement;
  fireEvent.click(screen.getByRole("checkbox", { name: "Pressure" }));
  fireEvent.change(rate, { target: { value: "400" } });
  await until(".budget-bar .excess");
  expect(button("Apply").disabled).toBe(true);
  expect(find("#apply-why").textContent).toContain("% of the link");
  fireEvent.click(button("Fit to link"));
  await waitFor(() => expect(find(".fit-words").textContent).toContain("→"));
  await gone(".budget-bar .excess");
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
});

const ofFamily = (family: "xbus" | "isb"): SnapshotBody =>
  recorded(family).answers["GET /api/devices/1/values"] as SnapshotBody;

test.each([
  ["xbus", "PortConfig", ["words.0"], ["this link"]],
  ["isb", "DID_FLASH_CONFIG", ["ser0BaudRate", "ser1BaudRate"], ["perhaps this link", "perhaps this link"]],
] as const)("the port in use of %s is marked, as far as it is known", async (family, place, ports, marks) => {
  const values = { ...ofFamily(family), ports: ports.map((port) => `${place}.${port}`) };
  await openConfigure(family, { place, answers: { "GET /api/devices/1/values": values } });
  const tags = () => [...document.querySelectorAll(".setting .tag")].map(({ textContent }) => textContent);
  await waitFor(() => expect(tags().filter((words) => words?.endsWith("this link"))).toEqual(marks));
});

/** Regression: the bar stood two screens below the rate of an IMX, and Apply beside nothing. */
test("the load of the link at another rate stands beside Apply", async () => {
  const load = { parts: [], total: 21_000, capacity: 11_520, baud: 115_200, limits: [], measured: null };
  const preview = { frames: [], problems: [], load, line: "Sets serial port 0 to 115 200 Bd.", risks: [] };
  await openConfigure("isb", { place: "DID_FLASH_CONFIG", answers: { "POST /api/devices/1/preview": preview } });
  fireEvent.change(await until("[data-field=ser0BaudRate] select"), { target: { value: "115200" } });
  await waitFor(() => expect(find(".apply-bar .tag.bad").textContent).toMatch(/182.3 % of 115.200 Bd/));
});

test("a row, its bytes and its share of the line are highlighted together", async () => {
  await openConfigure("xbus");
  fireEvent.change(await until('tr[data-id="0x4020"] select'), { target: { value: "50" } });
  const bytes = await until(".hex-part.changed");
  expect(bytes.textContent?.replace(/\s+/g, " ").trim()).toMatch(/^40 20 00 32/);
  expect(document.querySelectorAll(".hex-part.changed").length).toBe(1);
  expect(document.querySelectorAll(".budget-bar i.changed").length).toBe(1);
  expect(find(".previous").textContent).toBe("was 100 Hz");
  fireEvent.pointerEnter(find('tr[data-id="0x4020"]'));
  const lit = (): string =>
    [...document.querySelectorAll("tr.highlighted, .hex-part.highlighted, .budget-bar i.highlighted")]
      .map((e) => e.tagName)
      .sort()
      .join();
  await waitFor(() => expect(lit()).toBe("I,SPAN,TR"));
});

/** Regression: each of the eight fields of a new entry read "was —". */
test("an entry that was added is new, and its fields had no values before", async () => {
  await openConfigure("xbus", { place: "SyncSettings" });
  fireEvent.click(await screen.findByRole("button", { name: "Add an entry" }));
  const entry = await until("[data-setting=SyncSettings] .list li.changed");
  expect(entry.querySelector("summary .tag")?.textContent).toBe("new");
  expect(entry.querySelectorAll(".field-row").length).toBeGreaterThan(5);
  expect(entry.querySelector(".previous")).toBeNull();
});

test("a dangerous command needs confirmation before anything is sent", async () => {
  const page = await openConfigure("xbus", { place: "RestoreFactoryDef" });
  fireEvent.click(await screen.findByRole("button", { name: "Send" }));
  const dialog = await until("dialog");
  const form = page.forms.commands.find(({ name }) => name === "RestoreFactoryDef");
  expect(form?.consequence).toBeTruthy();
  expect(dialog.textContent).toContain(form?.consequence);
  expect(document.activeElement?.textContent).toBe("Leave unchanged");
  fireEvent.click(within(dialog).getByText("Leave unchanged"));
  await gone("dialog");
  expect(posts(page, "/run")).toBe(0);
});

test.each(["OutputConfiguration", "Output%20configuration"])(
  "outputs that were not read are not shown as none: %s",
  async (place) => {
    const page = await openConfigure("xbus", { place, unread: true, answers: onlyLocation() });
    await until(".unread");
    await until("[data-setting=OutputConfiguration]");
    expect(find("[data-setting=OutputConfiguration] .unread").textContent).toContain(PAUSE);
    expect(document.querySelector("[data-setting=OutputConfiguration] .budget")).toBeNull();
    expect(document.querySelector("[data-setting=OutputConfiguration] table")).toBeNull();
    fireEvent.click(button("Read again"));
    await waitFor(() => expect(posts(page, "/read")).toBe(1));
    const preview = Object.entries(recorded("xbus").answers).find(([key]) => key.includes("/preview {"))?.[1];
    expect(preview).toBeDefined();
    await openConfigure("xbus", { place, answers: { "POST /api/devices/1/preview": preview } });
    await until("[data-setting=OutputConfiguration] .budget");
    expect(document.querySelector(".unread")).toBeNull();
  },
);

test("a device that a driver uses is not read, which is said with what reading does, and is one click away", async () => {
  const client = { number: 3, peer: "/dev/pts/7", name: "robot_driver (process 812)", may_write: true };
  const shares = [{ name: "/run/imu0", kind: "pty", read_only: false, clients: [client] }];
  const port = { why_not: "", folder: "", holder: 9, speaker: "", configuring: false, changes: [], shares };
  const page = await openConfigure("xbus", {
    place: "LocationID",
    unread: true,
    answers: { "GET /api/devices/1/shares": port },
  });
  const card = (await screen.findByText("Not read yet")).closest(".card") as HTMLElement;
  const words = `Also used by robot_driver (process 812), so imuscope reads the settings only on request. ${PAUSE}`;
  await waitFor(() => expect(card.querySelector(".hint")?.textContent).toBe(words));
  expect(posts(page, "/read")).toBe(0);
  fireEvent.click(within(card).getByRole("button"));
  await waitFor(() => expect(posts(page, "/read")).toBe(1));
});

/** Values of a device of which only LocationID was read. */
function onlyLocation(): Record<string, unknown> {
  const info = { name: "x", title: "x", taken: 1_790_000_000, reason: "", settings: 1, missing: 0 };
  return { "GET /api/devices/1/values": { info, values: { LocationID: { locationId: 0 } }, missing: {} } };
}

test("a device with read settings is never shown as unread", async () => {
  let shown = false;
  const observer = new MutationObserver(
    () => (shown ||= document.body.textContent?.includes("Read settings") ?? false),
  );
  observer.observe(document, { childList: true, subtree: true });
  await openConfigure("xbus", { slow: "/values" });
  await until('tr[data-id="0x4020"] select');
  observer.disconnect();
  expect(shown).toBe(false);
});

test("restoring communication is offered without a rollback having failed", async () => {
  const page = await openConfigure("xbus", { place: "compare" });
  fireEvent.click(await screen.findByRole("link", { name: "Restore communication" }));
  page.goTo("restore");
  await waitFor(() => within(screen.getByLabelText("Restore communication")).getByRole("button", { name: "Start" }));
});

test("the command of a data set opens with the device's values", async () => {
  const page = await openConfigure("isb", { place: "SET_DID_FLASH_CONFIG" });
  const shown = (await until('[data-command="SET_DID_FLASH_CONFIG"] input[id$="startupNavDtMs"]')) as HTMLInputElement;
  const { startupNavDtMs } = page.values["DID_FLASH_CONFIG"] as { startupNavDtMs: number };
  expect(startupNavDtMs).toBeGreaterThan(0);
  expect(Number(shown.value)).toBe(startupNavDtMs);
});

test("a command that needs unread values offers to read them first", async () => {
  await openConfigure("isb", { place: "SET_DID_FLASH_CONFIG", unread: true });
  await screen.findByRole("button", { name: "Read settings" });
  expect(document.querySelector('[data-command="SET_DID_FLASH_CONFIG"] input')).toBeNull();
});

test("temporary settings report a disconnected server and disable their buttons", async () => {
  const page = await openConfigure("xbus");
  const words = "The device answers at 921 600 Bd.";
  const deadline = Date.now() / 1000 + 20;
  page.tell({ pending_rollback: { device: "1", state: "pending", changes: [], words, deadline, seconds: 20 } });
  await until(".pending-rollback");
  const both = (): boolean[] => ["Confirm", "Roll back now"].map((name) => button(name).disabled);
  await waitFor(() => expect(both()).toEqual([false, false]));
  page.store.receive({ kind: "connection", state: "closed", nextTry: undefined });
  await waitFor(() => expect(find(".pending-rollback .ring b").textContent).toBe("—"));
  expect(find("#deck-words").textContent).toContain("The server is unreachable");
  expect(both()).toEqual([true, true]);
});

test("a view-only user sees everything and can change nothing", async () => {
  await openConfigure("xbus", { isViewOnly: true });
  await waitFor(() => expect(document.body.textContent).toContain("View only"));
  expect(button("Read again").disabled).toBe(true);
});

test("typed input stays while the device is disconnected", async () => {
  const { store } = await openConfigure("xbus");
  const rate = (await until('tr[data-id="0x4020"] select')) as HTMLSelectElement;
  fireEvent.change(rate, { target: { value: "50" } });
  await waitFor(() => expect(button("Apply").disabled).toBe(false));
  const lost = (): boolean =>
    [...document.querySelectorAll(".band")].some(({ textContent }) => /^Lost/.test(textContent?.trim() ?? ""));
  const devices = store.devices.value;
  const tell = (status: "lost" | "live"): void =>
    store.receive({
      kind: "text",
      text: { op: "devices", devices: devices.map((one) => ({ ...one, status, is_open: status === "live" })) },
    });
  tell("lost");
  await waitFor(() => expect(lost()).toBe(true));
  expect(button("Apply").disabled).toBe(true);
  tell("live");
  await waitFor(() => expect(lost()).toBe(false));
  expect((find('tr[data-id="0x4020"] select') as HTMLSelectElement).value).toBe("50");
});

test("two pages beside each other have their own edits, level of detail and search", async () => {
  const { store } = await openConfigure("xbus");
  render(<ConfigurePage app={newApp(store)} />);
  const row = 'tr[data-id="0x4020"] select';
  const [left, right] = [...document.querySelectorAll<HTMLElement>(".app.configure")];
  if (left === undefined || right === undefined) throw new Error("not two pages");
  await waitFor(() => expect(right.querySelector(row)).not.toBeNull());
  fireEvent.change(left.querySelector(row) as HTMLElement, { target: { value: "50" } });
  fireEvent.click(within(left).getByRole("button", { name: "All" }));
  fireEvent.input(within(left).getByRole("searchbox"), { target: { value: "baud" } });
  await waitFor(() => expect(left.querySelector(".found a")).not.toBeNull());
  await waitFor(() => expect(left.querySelector(".apply-bar")).not.toBeNull());
  expect(left.querySelector(".setting.edited")).not.toBeNull();
  expect(within(left).getByText("All").getAttribute("aria-pressed")).toBe("true");
  expect(right.querySelector("dialog, .found, .apply-bar, .setting.edited")).toBeNull();
  expect(within(right).getByText("All").getAttribute("aria-pressed")).toBe("false");
  expect(right.querySelector<HTMLInputElement>("input[type=search]")?.value).toBe("");
  expect(right.querySelector<HTMLSelectElement>(row)?.value).toBe("100");
});

/** Regression: seven payloads marked "Action" looked like its settings. */
test("a sensor without settings is said to have none, and what it would be sent is said to be sent", async () => {
  await openConfigure("idtp");
  const list = await until(".commands");
  expect(find("[role=note]").textContent).toContain("has no settings: it only sends.");
  expect(list.textContent).not.toContain("Action");
  expect(list.querySelectorAll("li").length).toBe((list.textContent ?? "").split("sent to the device").length - 1);
});
