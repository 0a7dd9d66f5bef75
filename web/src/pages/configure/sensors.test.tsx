// @vitest-environment happy-dom
/** Edits, links and questions are about one sensor, whatever its number in this run and whichever port it is on. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import type { SettingForm, SnapshotBody } from "../../wire/form-types";
import { openConfigure, type Opened } from "../../testing/configure-page";
import { recorded } from "../../testing/recorded";
import { configureOf } from "./view-state";
import { type Model, modelOf } from "./model";

function editOutputs(model: Model): void {
  const form = model.setting("OutputConfiguration");
  if (form === undefined) throw new Error("no such setting");
  model.edit(form, ["outputs"], []);
}

function swapped(page: Opened, changes: object): void {
  const devices = page.store.devices.value.map((one) => ({ ...one, ...changes }));
  page.store.receive({ kind: "text", text: { op: "devices", devices } });
}

test("edits for one sensor are put aside when another one comes, and are back with it on any port", async () => {
  const page = await openConfigure("xbus", { place: "OutputConfiguration" });
  const model = modelOf("1", page.app);
  const [one] = page.store.devices.value;
  if (one === undefined || one.serial_number === "") throw new Error("no serial number was recorded");
  await waitFor(() => expect(model.isRead.value).toBe(true));
  editOutputs(model);
  expect(model.drafts.value).toHaveProperty("OutputConfiguration");

  swapped(page, { serial_number: "0080800009", key: "xbus-0080800009" });
  await waitFor(() => expect(model.drafts.value).toEqual({}));
  expect(model.blocked.value).toBe("");
  expect(document.querySelector("[data-key=another-sensor]")?.textContent).toContain(
    `This is ${one.name} · 0080800009. Edits of 1 setting for ${one.name} · ${one.serial_number} are stored until it is back`,
  );
  expect(screen.queryByRole("button", { name: "Apply" })).toBeNull();

  const back = { ...one, id: "7" };
  page.store.receive({ kind: "text", text: { op: "devices", devices: [...page.store.devices.value, back] } });
  const moved = modelOf("7", page.app);
  await waitFor(() => expect(moved.drafts.value).toHaveProperty("OutputConfiguration"));
  expect(moved.writeName).toBe(one.key);
  expect(configureOf(page.app).aside.size).toBe(0);
});

/** Regression: a reload, or the browser's own after an update, lost every edit without a question. */
test("edits survive a reload, and what was changed elsewhere meanwhile is said", async () => {
  const values = recorded("xbus").answers["GET /api/devices/1/values"] as SnapshotBody;
  const { outputs } = values.values["OutputConfiguration"] as {
    outputs: readonly { readonly data_identifier: number }[];
  };
  const first = await openConfigure("xbus", { place: "OutputConfiguration" });
  const before = modelOf("1", first.app);
  await waitFor(() => expect(before.isRead.value).toBe(true));
  const edited = outputs.map((one) => (one.data_identifier === 0x4020 ? { ...one, output_frequency: 50 } : one));
  before.edit(before.setting("OutputConfiguration") as SettingForm, ["outputs"], edited);
  before.reason.value = "slower";

  const again = await openConfigure("xbus", { place: "OutputConfiguration" });
  const after = modelOf("1", again.app);
  await waitFor(() => expect(after.counts.value.get("OutputConfiguration")).toBe(1));
  expect(after.reason.value).toBe("slower");
  await screen.findByRole("button", { name: "Apply" });
  expect(after.elsewhere.value).toEqual([]);

  const theirs = outputs.map((one) => (one.data_identifier === 0x4020 ? { ...one, output_frequency: 25 } : one));
  const now = { ...values, values: { ...values.values, OutputConfiguration: { outputs: theirs } } };
  const answers = { "GET /api/devices/1/values": now };
  const changed = modelOf("1", (await openConfigure("xbus", { place: "OutputConfiguration", answers })).app);
  expect((await screen.findByText("Changed elsewhere")).closest(".band")?.textContent).toContain("25 Hz");
  expect(changed.counts.value.get("OutputConfiguration")).toBe(1);
  expect(changed.basesOf(["OutputConfiguration"])).toEqual({ OutputConfiguration: { outputs: theirs } });

  changed.discard();
  const last = modelOf("1", (await openConfigure("xbus", { place: "OutputConfiguration" })).app);
  await waitFor(() => expect(last.isRead.value).toBe(true));
  expect(last.drafts.value).toEqual({});
});

test("a change is addressed to the sensor, and refused at another one's port", async () => {
  const page = await openConfigure("xbus", { place: "OutputConfiguration" });
  const [one] = page.store.devices.value;
  const model = modelOf("1", page.app);
  await waitFor(() => expect(model.isRead.value).toBe(true));
  editOutputs(model);
  fireEvent.click(await screen.findByRole("button", { name: "Apply" }));
  await waitFor(() => expect(page.asked.map(({ address }) => address)).toContain(`/api/devices/${one?.key}/apply`));
});

test("a sensor that nobody has confirmed since its link was lost is named so", async () => {
  const page = await openConfigure("xbus");
  expect(document.querySelector("[data-key=unconfirmed]")).toBeNull();
  swapped(page, { unconfirmed_since: 1_732_000_000 });
  await waitFor(() => expect(document.querySelector("[data-key=unconfirmed]")?.textContent).toContain("Read settings"));
});

test("a link to a sensor that is not there says so", async () => {
  const page = await openConfigure("xbus");
  expect(document.querySelector("[data-key=linked]")).toBeNull();
  location.hash = "#/configure/xbus-0011223344/compare";
  dispatchEvent(new HashChangeEvent("hashchange"));
  await waitFor(() => expect(document.querySelector("[data-key=linked]")?.textContent).toContain("xbus-0011223344"));
  location.hash = `#/configure/${page.store.devices.value[0]?.key}/compare`;
  dispatchEvent(new HashChangeEvent("hashchange"));
  await waitFor(() => expect(document.querySelector("[data-key=linked]")).toBeNull());
});

test("a question names the sensor it is about", async () => {
  const page = await openConfigure("xbus");
  const model = modelOf("1", page.app);
  model.page.question.value = {
    title: "Sure?",
    about: model.fullName,
    words: [],
    caution: "",
    go: "Do",
    act: () => {},
  };
  await waitFor(() =>
    expect(screen.getByRole("dialog").textContent).toContain(page.store.devices.value[0]?.serial_number),
  );
});

test("a device that somebody stopped is not lost, and one button makes it measure again", async () => {
  const page = await openConfigure("xbus", { answers: { "POST /api/devices/1/run": { id: 9, state: "waiting" } } });
  const message = "Send hex put it into the config state, in which it sends no data.";
  swapped(page, { status: "idle", is_open: true, message, hint: "Send GoToMeasurement.", resume: "GoToMeasurement" });
  const band = await waitFor(() => {
    const found = document.querySelector<HTMLElement>("[data-key=quiet]");
    if (found === null) throw new Error("no band");
    return found;
  });
  expect(band.textContent).toContain(message);
  fireEvent.click(screen.getByRole("button", { name: "Measure again" }));
  const run = () => page.asked.filter(({ path }) => path === "/api/devices/1/run");
  await waitFor(() => expect(run()).toMatchObject([{ body: { command: "GoToMeasurement", confirmed: false } }]));
});
