// @vitest-environment happy-dom
/** The comparison of a robot's settings in its details, and making them the profile of its group. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { beforeEach, expect, test } from "vitest";
import { deviceWith, robotWith } from "./fixtures";
import { openPage } from "../../../testing/live-page";
import { answering, recorded } from "../../../testing/recorded";
import type { DeviceSettingsCheck, FleetRobots } from "../../../wire/routes";
import { serverKind } from "../server-kind";
import type { Fleet } from "./fleet-state";
import { SettingsCheck } from "./settings";

const PATIENCE = { timeout: 30_000 };
const CHECK: DeviceSettingsCheck = {
  device: "1",
  name: "A-100",
  state: "drifted",
  why: "",
  read: 1_700_000_000,
  profile: { robot: "heron", device: "A-100", by: "Ben", time: 1_700_000_000 },
  same: 40,
  rows: [{ title: "Rate", unit: "Hz", profile: "100 Hz", robot: "400 Hz" }],
  missing: { CanConfig: "Robot: no answer" },
};

beforeEach(() => localStorage.clear());

test("a comparison that is refused after a change leaves no old one", async () => {
  const refusal = { kind: "unread", message: "REFUSED", hint: "" };
  let isRefused = false;
  answering({
    "GET /api/fleet/robots/otter/settings": () => (isRefused ? Response.json(refusal, { status: 409 }) : [CHECK]),
  });
  const page = (state: "drifted" | "as-profile") => (
    <SettingsCheck robot={robotWith({ name: "otter", settings: state })} fleet={{ retry: () => {} } as Fleet} />
  );
  const { container, rerender } = render(page("drifted"));
  const details = container.querySelector("details") as HTMLDetailsElement;
  details.open = true;
  fireEvent(details, new Event("toggle"));
  await screen.findByText("400 Hz");
  isRefused = true;
  rerender(page("as-profile"));
  await screen.findByText("REFUSED");
  expect(screen.queryByText("400 Hz")).toBeNull();
});

test("what differs is listed, and the robot's settings become the profile with a name", async () => {
  const robots = [
    robotWith({ name: "otter", settings: "drifted", drifted: 1, devices: [deviceWith({ settings: "a" })] }),
  ];
  const fleet: FleetRobots = { revision: 1, time: 1_700_000_100, complete: true, gone: [], robots };
  const after = { ...CHECK, rows: [], profile: { robot: "otter", device: "A-100", by: "Ada", time: 1_700_000_100 } };
  const { app, asked } = await openPage(recorded("library"), {
    place: "#/fleet?robot=otter",
    answers: {
      "GET /api/fleet/robots": () => fleet,
      "GET /api/fleet/robots/otter/settings": () => [CHECK],
      "POST /api/fleet/robots/otter/profile": () => [after],
    },
  });
  serverKind(app).isFleet.value = true;
  const summary = await screen.findByText("Settings and profile", {}, PATIENCE);
  const details = summary.closest("details") as HTMLDetailsElement;
  details.open = true;
  fireEvent(details, new Event("toggle"));
  const row = (await screen.findByText("400 Hz", {}, PATIENCE)).closest("tr");
  expect(row?.textContent).toBe("Rate100 Hz400 Hz");
  expect(details.textContent).toContain("Profile from heron, by Ben");
  expect(details.textContent).toContain("1 setting not compared");
  fireEvent.click(screen.getByRole("button", { name: "Use as the profile of its group" }));
  const name = await screen.findByLabelText<HTMLInputElement>("Your name");
  fireEvent.input(name, { target: { value: "Ada" } });
  fireEvent.submit(name.form as HTMLFormElement);
  await waitFor(() => expect(details.textContent).toContain("Profile from otter, by Ada"), PATIENCE);
  expect(asked.find(({ path }) => path.endsWith("/profile"))?.body).toEqual({ device: "1", by: "Ada" });
  expect(screen.queryByText("400 Hz")).toBeNull();
});
