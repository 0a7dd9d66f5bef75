// @vitest-environment happy-dom
/** Alarms in the details of a robot: those of the fleet server are acknowledged there, by name. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { beforeEach, expect, test } from "vitest";
import { robotWith } from "./fixtures";
import { openPage } from "../../../testing/live-page";
import { recorded } from "../../../testing/recorded";
import type { FleetRobots, RobotAlarm } from "../../../wire/routes";
import { serverKind } from "../server-kind";

const PATIENCE = { timeout: 30_000 };
const OWN: RobotAlarm = {
  name: "Hot",
  level: "error",
  state: "raised",
  device: "1",
  condition: "",
  acknowledged_by: "",
};
const LOSS: RobotAlarm = { ...OWN, name: "Loss above 1 %", level: "warning", device: "", condition: "loss" };

beforeEach(() => localStorage.clear());

test("an alarm of the fleet server is acknowledged by name, one of the robot on its own page", async () => {
  let alarms = [LOSS, OWN];
  const answer = (): FleetRobots => ({
    revision: alarms[0] === LOSS ? 1 : 2,
    time: 1_700_000_100,
    complete: true,
    gone: [],
    robots: [robotWith({ name: "otter", alarms })],
  });
  const { app, asked } = await openPage(recorded("library"), {
    place: "#/fleet?robot=otter",
    answers: {
      "GET /api/fleet/robots": answer,
      "POST /api/fleet/robots/otter/acknowledge": () => {
        alarms = [{ ...LOSS, state: "acknowledged", acknowledged_by: "Ada" }, OWN];
        return undefined;
      },
    },
  });
  serverKind(app).isFleet.value = true;
  const button = await screen.findByRole("button", { name: "Acknowledge Loss above 1 %" }, PATIENCE);
  expect(screen.queryByRole("button", { name: "Acknowledge Hot" })).toBeNull();
  fireEvent.click(button);
  const name = await screen.findByLabelText<HTMLInputElement>("Your name");
  fireEvent.input(name, { target: { value: "Ada" } });
  fireEvent.submit(name.form as HTMLFormElement);
  await waitFor(() => expect(document.body.textContent).toContain("acknowledged by Ada"), PATIENCE);
  expect(asked.find(({ path }) => path.endsWith("/acknowledge"))?.body).toEqual({ condition: "loss", by: "Ada" });
  expect(localStorage.getItem("imuscope.person")).toBe("Ada");
});
