// @vitest-environment happy-dom
/** The calibration coach: choice, progress, refusal, result, and what is sent. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { answering, type Asked } from "../../testing/recorded";
import type { CalibrationReport, CalibrationState } from "../../wire/routes";
import type { DeviceInfo, DeviceJobs, Job } from "../../wire/types";
import { CalibrationDialog } from "./dialog";
import { digits } from "./result";
import { cellPaths, screenPlaceOf } from "./progress";

const RINGS = [3, 9, 12];
const REPORT: CalibrationReport = {
  kind: "magnetometer",
  sensor: "MagneticField",
  unit: "µT",
  t0: 1_760_000_000,
  seconds: 12,
  samples: 1200,
  progress: 0.42,
  advice: "Turn the sensor until the ring passes the empty fields around −z.",
  refusal: { message: "Only 38 % of all directions were seen; 60 % are needed.", hint: "Turn it over." },
  correction: null,
  figures: [],
  notes: [],
  trace: null,
  coverage: {
    rings: RINGS,
    seen: Array.from({ length: 48 }, (_, k) => k < 18),
    share: 0.375,
    needed: 0.6,
    goal: 0.9,
    missing: ["−z"],
    now: [0, 0.6, -0.8],
  },
  rest: null,
  positions: null,
  drive: null,
};
const FOUND: CalibrationReport = {
  ...REPORT,
  progress: 1,
  refusal: null,
  correction: {
    unit: "µT",
    bias: [12.345, -6.5, 0.25],
    bias_uncertainty: [0.02, 0.03, 0.04],
    matrix: [
      [1.1, 0.02, 0],
      [0.02, 0.95, 0],
      [0, 0, 1],
    ],
    matrix_uncertainty: 0.001,
    presupposes: "± holds for an even field.",
  },
  figures: [
    { name: "before", title: "Residual before", value: 17.77, uncertainty: null, unit: "µT" },
    { name: "share", title: "", value: 31.67, uncertainty: null, unit: "%" },
    { name: "yaw", title: "Yaw", value: 23.456, uncertainty: 0.078, unit: "°" },
    { name: "rests", title: "Rests used", value: 6, uncertainty: null, unit: "" },
  ],
  notes: ["Valid as mounted."],
  trace: { title: "Strength of the field", unit: "µT", target: 48, before: [30, 60], after: [48, 48.1] },
};
const AVAILABLE: CalibrationState["available"] = [
  { kind: "gyroscope", title: "Gyroscope bias", problem: "", hint: "" },
  {
    kind: "magnetometer",
    title: "Magnetometer",
    problem: "The device sends no data of its magnetometer.",
    hint: "Add it.",
  },
];
const state = (report: CalibrationReport | null, isRunning: boolean): CalibrationState => ({
  available: AVAILABLE,
  is_running: isRunning,
  report,
  write: null,
});
const ROUTE = "/api/devices/1/calibration";

function open(answers: Record<string, unknown>): readonly Asked[] {
  const asked = answering(answers);
  render(
    <CalibrationDialog
      device={{ id: "1", name: "MTi-630" } as DeviceInfo}
      jobs={undefined}
      onClose={() => undefined}
    />,
  );
  return asked;
}

const sent = (asked: readonly Asked[], method: string): Asked | undefined =>
  asked.find((one) => one.method === method && one.path === ROUTE);

test("what a device cannot calibrate says why, and the rest starts with one press", async () => {
  const asked = open({ [`GET ${ROUTE}`]: state(null, false), [`POST ${ROUTE}`]: state(REPORT, true) });
  const gyroscope = await screen.findByRole("button", { name: /Gyroscope bias/ });
  const magnetometer = screen.getByRole("button", { name: /Magnetometer/ });
  expect((magnetometer as HTMLButtonElement).disabled).toBe(true);
  expect(screen.getByText(/sends no data of its magnetometer/)).toBeTruthy();
  fireEvent.click(gyroscope);
  await waitFor(() => expect(sent(asked, "POST") !== undefined).toBe(true));
  expect(sent(asked, "POST")?.body).toEqual({ kind: "gyroscope" });
});

test("progress: what to do, the cells that were seen, the ring, and why there is no result yet", async () => {
  open({ [`GET ${ROUTE}`]: state(REPORT, true) });
  expect(await screen.findByText(REPORT.advice)).toBeTruthy();
  expect(screen.getByRole("progressbar", { name: "Progress" }).getAttribute("aria-valuenow")).toBe("42");
  const sphere = screen.getByRole("img", { name: "38 % of all directions seen." });
  expect(sphere.querySelectorAll("path.seen")).toHaveLength(18);
  const [upper, lower] = sphere.querySelectorAll("svg");
  expect(upper?.querySelector("circle")).toBeNull();
  expect(Number(lower?.querySelector("circle")?.getAttribute("cy"))).toBeLessThan(0); // +y is up
  expect(screen.getByText(/Only 38 %/)).toBeTruthy();
  expect((screen.getByRole("button", { name: "Finish now" }) as HTMLButtonElement).disabled).toBe(true);
});

test("stopping discards, and finishing shows the result that the server answers with", async () => {
  const asked = open({
    [`GET ${ROUTE}`]: state({ ...REPORT, refusal: null }, true),
    [`POST ${ROUTE}/finish`]: state(FOUND, false),
    [`DELETE ${ROUTE}`]: "",
  });
  fireEvent.click(await screen.findByRole("button", { name: "Finish now" }));
  await screen.findByRole("region", { name: "Result" });
  fireEvent.click(await screen.findByRole("button", { name: "Stop" })); // the next answer has it running again
  await waitFor(() => expect(sent(asked, "DELETE") !== undefined).toBe(true));
});

test("the result has figures, bias, matrix, the residual before and after, and files", async () => {
  open({ [`GET ${ROUTE}`]: state(FOUND, false) });
  const result = await screen.findByRole("region", { name: "Result" });
  expect(result.textContent).toContain("17.8 µT · 31.7 %");
  expect(result.textContent).toContain("Rests used6");
  expect(result.textContent).toContain("23.456 ± 0.078°");
  expect(result.textContent).not.toContain("6.00");
  expect(result.textContent).toContain("12.345± 0.020");
  expect(result.textContent).toContain("1.100000.020000.00000");
  expect(result.querySelectorAll("polyline")).toHaveLength(2);
  const files = screen.getByRole("group", { name: "Export" }).querySelectorAll("a");
  expect([...files].map((file) => file.getAttribute("href"))).toContain(`${ROUTE}/export?format=yaml`);
  fireEvent.click(screen.getByRole("button", { name: "Other calibrations" }));
  expect(await screen.findByRole("button", { name: /Gyroscope bias/ })).toBeTruthy();
});

test("rest, positions and drive are shown as far as a calibration has them", async () => {
  open({
    [`GET ${ROUTE}`]: state(
      {
        ...REPORT,
        coverage: null,
        rest: { is_still: false, motion: 3, seconds: 4, needed: 10, goal: 30 },
        positions: {
          positions: [
            { up: "+x", seconds: 3, is_done: true },
            { up: "−x", seconds: 1, is_done: false },
          ],
          now: "−x",
          seconds: 2,
        },
        drive: { rest_s: 2, rest_needed_s: 4, speed_change: 1, speed_needed: 4, turn: 1, turn_allowed: 5 },
      },
      true,
    ),
  });
  expect((await screen.findByText("Moving")).textContent).toBe("Moving");
  expect(screen.getByRole("progressbar", { name: "Stillness" }).getAttribute("aria-valuenow")).toBe("0");
  const [done, now] = screen.getByRole("list", { name: "Positions" }).querySelectorAll("li");
  expect(done?.textContent).toBe("+x updone");
  expect(now?.textContent).toBe("−x upnow");
  expect(screen.getByRole("list", { name: "Drive" }).textContent).toContain("1.0 of 4.0 m/s");
});

test("a result is written like any change: asked once, then carried out, with its job", async () => {
  const apply = "POST /api/devices/1/apply";
  const write = { setting: "Rot", title: "Alignment", note: "It moves.", values: { q0: 1 }, problem: "", hint: "" };
  const job = { id: 7, title: "Write 1 setting", state: "done", message: "Read back equal.", step: "" } as Job;
  const harm = { kind: "confirm", message: "All data move.", hint: "Send it again." };
  const answers: Record<string, unknown> = {
    [`GET ${ROUTE}`]: { ...state({ ...FOUND, kind: "mounting" }, false), write },
    [apply]: Response.json(harm, { status: 409 }),
  };
  const asked = answering(answers);
  const jobs = { device: "1", running: null, queue: [], done: [job], pending_rollback: null } as unknown as DeviceJobs;
  const device = { id: "1", name: "MTi-630" } as DeviceInfo;
  render(<CalibrationDialog device={device} jobs={jobs} onClose={() => undefined} />);
  fireEvent.click(await screen.findByRole("button", { name: "Write to the device" }));
  expect((await screen.findByRole("alert")).textContent).toContain("All data move.");
  expect(screen.queryByRole("status")).toBeNull();
  answering({ ...answers, [apply]: job }).push(...asked);
  fireEvent.click(screen.getByRole("button", { name: "Continue" }));
  expect((await screen.findByRole("status")).textContent).toContain("Read back equal. The previous settings");
});

test("a device that was not read is read first, which writes nothing", async () => {
  const problem = "The settings of the device have not been read yet.";
  const write = { setting: "Rot", title: "Alignment", note: "", values: null, problem, hint: "Read them first." };
  const found = state({ ...FOUND, kind: "mounting" }, false);
  let now: object = { ...found, write };
  const asked = answering({ [`GET ${ROUTE}`]: () => now, "POST /api/devices/1/read": { id: 3 } });
  const job = { id: 3, title: "Read the settings", state: "done", message: "12 settings read.", step: "" } as Job;
  const jobs = { device: "1", running: null, queue: [], done: [job], pending_rollback: null } as unknown as DeviceJobs;
  const device = { id: "1", name: "MTi-630" } as DeviceInfo;
  render(<CalibrationDialog device={device} jobs={jobs} onClose={() => undefined} />);
  fireEvent.click(await screen.findByRole("button", { name: "Read the settings" }));
  await waitFor(() => expect(asked.some(({ path }) => path === "/api/devices/1/read")).toBe(true));
  now = { ...found, write: { ...write, values: { q0: 1 }, problem: "" } };
  await screen.findByRole("button", { name: "Write to the device" }, { timeout: 20_000 });
  expect(screen.getByRole("status").textContent).toContain("12 settings read.");
  expect(screen.getByRole("status").textContent).not.toContain("The previous settings");
});

test("a refusal of the server is shown", async () => {
  open({
    [`GET ${ROUTE}`]: state(null, false),
    [`POST ${ROUTE}`]: Response.json({ kind: "view-only", message: "View-only.", hint: "" }, { status: 403 }),
  });
  fireEvent.click(await screen.findByRole("button", { name: /Gyroscope bias/ }));
  expect((await screen.findByRole("alert")).textContent).toContain("View-only.");
});

test("cells fill the disc, and a direction has its place in one of the halves", () => {
  expect(cellPaths(RINGS, 90)).toHaveLength(24);
  expect(screenPlaceOf([0, 0, 1])).toEqual({ half: 0, x: 0, y: 0 });
  expect(screenPlaceOf([1, 0, 0])).toEqual({ half: 0, x: 1, y: 0 });
  const below = screenPlaceOf([0, Math.SQRT1_2, -Math.SQRT1_2]);
  expect(below?.half).toBe(1);
  expect(below?.y).toBeCloseTo(Math.sqrt(1 - Math.SQRT1_2));
  expect(screenPlaceOf([])).toBeUndefined();
});

test("numbers have the digits that count", () => {
  expect(digits(0.00084345)).toBe("0.000843");
  expect(digits(1234.5)).toBe("1\u2009235");
  expect(digits(0)).toBe("0");
  expect(digits(undefined)).toBe("—");
});
