// @vitest-environment happy-dom
/** The form of an alarm: what it sends, and where it marks a mistake. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp } from "../../testing/live-page";
import { answering } from "../../testing/recorded";
import type { AlarmDefinition } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { AlarmDialog, Mistake } from "./dialog";
import { definitionOf, fieldsOf } from "./fields";

const STORED: AlarmDefinition = {
  name: "Hot",
  condition: { kind: "expression", expression: "Temperature > 60 °C", clear: "55 °C" },
  devices: { device: "", product: "", family: "xbus" },
  level: "error",
  raise_s: 2,
  clear_s: 5,
  missing_s: 7,
  latched: true,
  enabled: false,
  webhook: "https://example.org/…",
  recording: { before_s: 20, after_s: 0, longest_s: 90, per_hour: 2, every_device: true },
};
const DEVICE = { id: "1", serial_number: "0080A1B2", source: "sim:xbus", name: "MTi-630" } as DeviceInfo;

const valid = { valid: true, message: "", hint: "", begin: null, end: null, devices: ["MTi-630"], notes: [] };

test("a stored alarm comes out of the form as it went in, with what the form does not show", () => {
  expect(definitionOf(fieldsOf({ id: "a", definition: STORED }, DEVICE), STORED)).toEqual(STORED);
  const flag: AlarmDefinition = { ...STORED, condition: { kind: "flag", signal: "S", flag: "F", is_set: false } };
  expect(definitionOf(fieldsOf({ id: "a", definition: flag }, DEVICE), flag)).toEqual(flag);
  for (const clear of [null, 3]) {
    const health: AlarmDefinition = { ...STORED, condition: { kind: "health", figure: "loss", limit: 2.5, clear } };
    expect(definitionOf(fieldsOf({ id: "a", definition: health }, DEVICE), health)).toEqual(health);
  }
});

test("a new alarm is for the device by its serial number, and named by its condition", () => {
  const made = definitionOf(fieldsOf({ expression: "Temperature > 60 °C" }, DEVICE), undefined);
  expect(made.name).toBe("Temperature > 60 °C");
  expect(made.devices).toEqual({ device: "0080A1B2", product: "", family: "" });
});

test("an alarm records when that is chosen, and no longer when it is not", async () => {
  const asked = answering({ "POST /api/alarms/check": valid, "POST /api/alarms": {}, "GET /api/alarms": [] });
  render(<AlarmDialog app={newApp()} onClose={vi.fn()} />);
  const condition = screen.getByLabelText<HTMLInputElement>("Condition");
  fireEvent.input(condition, { target: { value: "Temperature > 60 °C" } });
  const sent = async (count: number): Promise<AlarmDefinition> => {
    fireEvent.submit(condition.form as HTMLFormElement);
    const added = () => asked.filter(({ method, path }) => method === "POST" && path === "/api/alarms");
    await waitFor(() => expect(added().length).toBe(count));
    return added().at(-1)?.body as AlarmDefinition;
  };
  expect((await sent(1)).recording).toBe(null);
  fireEvent.change(screen.getByLabelText("When raised"), { target: { value: "device" } });
  fireEvent.input(screen.getByLabelText("Record before (s)"), { target: { value: "30" } });
  const expected = { before_s: 30, after_s: 10, longest_s: 600, per_hour: 6, every_device: false };
  expect((await sent(2)).recording).toEqual(expected);
  fireEvent.change(screen.getByLabelText("When raised"), { target: { value: "" } });
  expect((await sent(3)).recording).toBe(null);
});

test("an alarm that is saved by a double click is added once", async () => {
  const asked = answering({ "POST /api/alarms/check": valid, "POST /api/alarms": {}, "GET /api/alarms": [] });
  const close = vi.fn();
  render(<AlarmDialog app={newApp()} onClose={close} />);
  const condition = screen.getByLabelText<HTMLInputElement>("Condition");
  fireEvent.input(condition, { target: { value: "Temperature > 60 °C" } });
  const form = (await waitFor(() => screen.getByDisplayValue<HTMLInputElement>("Temperature > 60 °C"))).form;
  for (const _ of [1, 2]) fireEvent.submit(form as HTMLFormElement);
  await waitFor(() => expect(close).toHaveBeenCalled());
  expect(asked.filter(({ method, path }) => method === "POST" && path === "/api/alarms")).toHaveLength(1);
});

test("a mistake is marked where it is", () => {
  const place = { hint: "", begin: 5, end: 10, devices: [], notes: [] };
  const check = { valid: false, message: "Not found. (character 6)", ...place };
  const { container, rerender } = render(<Mistake text="norm(Speed) > 3 g" check={check} />);
  expect(container.querySelector("mark")?.textContent).toBe("Speed");
  expect(container.textContent).not.toContain("character");
  rerender(<Mistake text="  norm(Speed) > 3 g" check={check} />);
  expect(container.querySelector("mark")?.textContent).toBe("Speed");
  rerender(<Mistake text="1 +" check={{ ...check, begin: 3, end: 4 }} />);
  expect(container.querySelector("mark")?.textContent).toBe("␣");
});

test("a new alarm is checked while it is typed, and added", async () => {
  const asked = answering({
    "POST /api/alarms/check": valid,
    "POST /api/alarms": {},
    "GET /api/alarms": [],
  });
  const app = newApp();
  const close = vi.fn();
  render(<AlarmDialog app={app} onClose={close} />);
  expect(screen.getByRole<HTMLButtonElement>("button", { name: "Save" }).disabled).toBe(true);
  fireEvent.input(screen.getByLabelText("Condition"), { target: { value: "norm(Acceleration) > 3 g" } });
  await waitFor(() => expect(asked.some(({ path }) => path === "/api/alarms/check")).toBe(true));
  fireEvent.submit(screen.getByLabelText<HTMLInputElement>("Condition").form as HTMLFormElement);
  await waitFor(() => expect(close).toHaveBeenCalled());
  const added = asked.find(({ method, path }) => method === "POST" && path === "/api/alarms");
  expect(added?.body).toMatchObject({
    name: "norm(Acceleration) > 3 g",
    condition: { kind: "expression", expression: "norm(Acceleration) > 3 g" },
  });
});

test("what is worth knowing about a condition stands below it", async () => {
  const notes = ["Causal filter: lowpass takes past samples only, and begins anew after a gap."];
  const valid = { valid: true, message: "", hint: "", begin: null, end: null, devices: [], notes };
  answering({ "POST /api/alarms/check": valid });
  render(<AlarmDialog app={newApp()} onClose={vi.fn()} />);
  const condition = screen.getByLabelText("Condition");
  fireEvent.input(condition, { target: { value: "lowpass(Acceleration.x, 5 Hz) > 1 g" } });
  const note = document.getElementById(condition.getAttribute("aria-describedby") ?? "");
  await waitFor(() => expect(note?.textContent).toBe(notes[0]));
});

test("an alarm is deleted by a second press", async () => {
  const asked = answering({ "POST /api/alarms/check": valid, "DELETE /api/alarms/a": null, "GET /api/alarms": [] });
  const app = newApp();
  app.subject.value = { id: "a", definition: STORED };
  const close = vi.fn();
  render(<AlarmDialog app={app} onClose={close} />);
  fireEvent.click(screen.getByRole("button", { name: "Delete" }));
  expect(asked.some(({ method }) => method === "DELETE")).toBe(false);
  fireEvent.click(await screen.findByRole("button", { name: "Delete this alarm?" }));
  await waitFor(() => expect(close).toHaveBeenCalled());
  expect(asked.some(({ method, path }) => method === "DELETE" && path === "/api/alarms/a")).toBe(true);
});

test("only a condition that was checked is judged over the past", async () => {
  const preview = { times: 0, t0: 0, t1: 600, worst: null, unit: "", seconds: 0, intervals: [] };
  const asked = answering({ "POST /api/alarms/check": valid, "POST /api/alarms/preview": preview });
  const app = newApp();
  app.subject.value = { device: DEVICE };
  render(<AlarmDialog app={app} onClose={vi.fn()} />);
  const condition = screen.getByLabelText("Condition");
  const texts = ["norm(Acceleration) > 3 g", "norm(Acceleration) >"];
  const requests = (): string[] =>
    asked.map(({ path, body }) => {
      const { definition = body, condition: own = (definition as AlarmDefinition).condition } = body as {
        definition?: AlarmDefinition;
        condition?: AlarmDefinition["condition"];
      };
      return `${path.split("/").at(-1)} ${own.kind === "expression" && own.expression}`;
    });
  for (const [i, value] of texts.entries()) {
    fireEvent.input(condition, { target: { value } });
    await waitFor(() => expect(requests()).toHaveLength(2 * (i + 1)));
  }
  expect(requests()).toEqual(texts.flatMap((text) => [`check ${text}`, `preview ${text}`]));
});
