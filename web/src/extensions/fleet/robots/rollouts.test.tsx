// @vitest-environment happy-dom
/** The profile of a group applied from the details of a robot: the plan, its start with a name, progress, and a stop. */
import { act, fireEvent, render, screen, waitFor, within } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import { deviceWith, robotWith } from "./fixtures";
import { openPage } from "../../../testing/live-page";
import { answering, recorded } from "../../../testing/recorded";
import type { DeviceSettingsCheck, FleetRobots, Rollout, RolloutDevice, RolloutPlan } from "../../../wire/routes";
import { serverKind } from "../server-kind";
import { GroupRollout } from "./group-rollout";
import { RolloutPlanForm } from "./rollout-plan";

const PATIENCE = { timeout: 30_000 };
const PROFILE = { robot: "heron", device: "A-100", by: "Ben", time: 1_700_000_000 };
const ROWS = [{ title: "Rate", now: "400 Hz", profile: "100 Hz" }];
const PLAN: RolloutPlan = {
  id: "p1",
  group: "Harbour",
  product: "A-100",
  profile: PROFILE,
  devices: [
    { robot: "otter", device: "1", name: "A-100", change: 0 },
    { robot: "seal", device: "1", name: "A-100", change: 0 },
    { robot: "whale", device: "1", name: "A-100", change: 1 },
  ],
  changes: [
    { rows: ROWS, risks: [] },
    { rows: ROWS, risks: ["The device restarts."] },
  ],
  left_out: [{ robot: "walrus", device: "1", name: "A-100", why: "The robot is lost." }],
  same: 7,
  waves: [1, 2],
  running: null,
};
const CHECK: DeviceSettingsCheck = {
  device: "1",
  name: "A-100",
  state: "drifted",
  why: "",
  read: 1_700_000_000,
  profile: PROFILE,
  same: 40,
  rows: [{ title: "Rate", unit: "Hz", profile: "100 Hz", robot: "400 Hz" }],
  missing: {},
};

function rolloutWith(part: Partial<Rollout>, states: readonly RolloutDevice["state"][]): Rollout {
  return {
    ...{ id: 3, group: "Harbour", product: "A-100", protocol: "a", profile: PROFILE, by: "Ada", state: "running" },
    ...{ words: "", stopped_by: "", started: 1_700_000_100, ended: null, watch_s: 5, waves: [1, 2], wave: 1 },
    devices: PLAN.devices.map(({ robot, device, name, change }, at) => ({
      ...{ robot, device, name, change, time: 1_700_000_100, wave: at === 0 ? 1 : 2, words: `words of ${robot}` },
      state: states[at] ?? "waiting",
    })),
    changes: PLAN.changes,
    ...part,
  };
}

beforeEach(() => localStorage.clear());

test("a plan is shown, started with a name, followed and stopped", async () => {
  const robots = [robotWith({ name: "otter", settings: "drifted", drifted: 1, devices: [deviceWith()] })];
  const fleet: FleetRobots = { revision: 1, time: 1_700_000_100, complete: true, gone: [], robots };
  let running = rolloutWith({}, ["watching"]);
  let all: readonly Rollout[] = [];
  const { app, asked } = await openPage(recorded("library"), {
    place: "#/fleet?robot=otter",
    answers: {
      "GET /api/fleet/robots": () => fleet,
      "GET /api/fleet/robots/otter/settings": () => [CHECK],
      "GET /api/fleet/rollouts": () => all,
      "GET /api/fleet/robots/otter/rollout": () => PLAN,
      "POST /api/fleet/robots/otter/rollout": () => running,
      "GET /api/fleet/rollouts/3": () => running,
      "POST /api/fleet/rollouts/3/stop": () => {
        running = rolloutWith({ stopped_by: "Ada" }, ["watching"]);
        return running;
      },
    },
  });
  serverKind(app).isFleet.value = true;
  const details = (await screen.findByText("Settings and profile", {}, PATIENCE)).closest(
    "details",
  ) as HTMLDetailsElement;
  details.open = true;
  fireEvent(details, new Event("toggle"));
  fireEvent.click(await screen.findByRole("button", { name: "Apply to the group" }, PATIENCE));
  const dialog = await screen.findByRole("dialog", { name: "Apply the profile to the group Harbour" }, PATIENCE);
  const start = await within(dialog).findByRole("button", { name: "Apply to 3 devices" }, PATIENCE);
  expect(within(dialog).getByText("otter, seal")).toBeTruthy();
  expect(within(dialog).getAllByText("400 Hz")).toHaveLength(2); // once for the robots with the same changes
  for (const words of ["The device restarts.", "1 device left out", "7 devices already", "The robot is lost."]) {
    expect(dialog.textContent).toContain(words);
  }
  fireEvent.input(within(dialog).getByLabelText("Your name"), { target: { value: "Ada" } });
  fireEvent.input(within(dialog).getByLabelText(/^Watch each for/), { target: { value: "5" } });
  fireEvent.submit(start.closest("form") as HTMLFormElement); // Enter in a field, which ends its typing: nothing begins
  fireEvent.click(start);
  await waitFor(() => expect(dialog.textContent).toContain("Wave 1 of 2 · 0 of 3 devices done"), PATIENCE);
  const sent = asked.filter(({ method, path }) => method === "POST" && path.endsWith("/rollout"));
  expect(sent).toHaveLength(1);
  expect(sent[0]?.body).toEqual({ device: "1", plan: "p1", by: "Ada", waves: "1, 5, 25 %", watch_s: 5 });
  fireEvent.click(within(dialog).getByRole("button", { name: "Stop" }));
  await waitFor(() => expect(dialog.textContent).toContain("Stopping: devices under way are finished."), PATIENCE);
  expect(asked.find(({ path }) => path.endsWith("/stop"))?.body).toEqual({ by: "Ada" });
  running = rolloutWith({ state: "failed", words: "It delivered 3 samples/s.", stopped_by: "Ada" }, [
    ...(["done", "failed", "not-started"] as const),
  ]);
  all = [running];
  await waitFor(() => expect(dialog.textContent).toContain("It delivered 3 samples/s."), PATIENCE);
  const rows = within(dialog).getAllByRole("listitem");
  expect(rows.map((row) => row.textContent)).toEqual([
    "seal, A-100words of sealfailed",
    "otter, A-100done",
    "whale, A-100words of whalenot started",
  ]);
  fireEvent.click(within(dialog).getByRole("button", { name: "Close" }));
  fireEvent.click(await screen.findByRole("button", { name: "Rollout 3 by Ada: failed" }, PATIENCE));
  const again = await screen.findByRole("dialog", {}, PATIENCE);
  await waitFor(() => expect(again.textContent).toContain("It delivered 3 samples/s."), PATIENCE);
});

test("waves that are refused leave no plan of others, and can be typed again", async () => {
  const refusal = { kind: "bad-value", message: "REFUSED", hint: "" };
  let isRefused = false;
  answering({
    "GET /api/fleet/robots/otter/rollout": () => (isRefused ? Response.json(refusal, { status: 422 }) : PLAN),
  });
  render(<RolloutPlanForm robot="otter" device="1" follow={() => undefined} />);
  const start = await screen.findByRole<HTMLButtonElement>("button", { name: "Apply to 3 devices" });
  const type = (words: string): void =>
    void fireEvent.change(screen.getByLabelText("Waves"), { target: { value: words } });
  fireEvent.input(screen.getByLabelText("Your name"), { target: { value: "Ada" } });
  isRefused = true;
  type("0");
  await screen.findByText("REFUSED");
  expect([screen.queryByText("otter, seal"), start.disabled]).toEqual([null, true]);
  isRefused = false;
  type("1, 2");
  await waitFor(() => expect(start.disabled).toBe(false));
  expect([screen.queryByText("REFUSED"), screen.queryByText("otter, seal") === null]).toEqual([null, false]);
  expect(screen.getByLabelText<HTMLInputElement>("Your name").value).toBe("Ada");
});

test("a rollout is followed further after a question without an answer", async () => {
  vi.useFakeTimers();
  const head = (state: string) => [{ id: 3, group: "Harbour", product: "A-100", protocol: "xbus", by: "Ada", state }];
  const answers = [() => head("running"), () => new Response("", { status: 502 }), () => head("done")];
  answering({ "GET /api/fleet/rollouts": () => answers.shift()?.() });
  const device = deviceWith({ product: "A-100", protocol: "xbus" });
  const robot = robotWith({ group: "Harbour", devices: [device] });
  render(<GroupRollout robot={robot} device={device.id} open={() => undefined} isShown={false} />);
  const pass = (ms: number): Promise<void> => act(async () => void (await vi.advanceTimersByTimeAsync(ms)));
  await pass(100);
  expect(screen.getByText("Rollout 3 by Ada: running")).toBeTruthy();
  await pass(7000);
  expect(screen.getByText("Rollout 3 by Ada: done")).toBeTruthy();
  vi.useRealTimers();
});
