// @vitest-environment happy-dom
/** The dialog of ROS 2 topics: who subscribes, what a device lacks, and one switch for each topic. */
import { cleanup, fireEvent, render, screen } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { openPage } from "../../testing/live-page";
import { answering, type Asked, recorded } from "../../testing/recorded";
import type { RosState, RosTopic } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { RosTopics } from "./topics";

const TOPIC: RosTopic = {
  key: "1 imu/data",
  device: "1",
  node: "/mti_630",
  name: "/mti_630/imu/data",
  type: "sensor_msgs/msg/Imu",
  hash: "RIHS01_00",
  enabled: true,
  subscribers: 2,
  rate: 100,
  messages: 1200,
  bytes: 384_000,
  problem: "",
};
const STATE: RosState = {
  enabled: true,
  router: "tcp/127.0.0.1:7447",
  domain: 0,
  namespace: "",
  connected: true,
  peers: 0,
  dropped: 0,
  problem: "",
  hint: "",
  topics: [TOPIC, { ...TOPIC, key: "2 imu/data", device: "2", name: "/imx_5/imu/data" }],
  missing: [{ device: "1", topic: "imu/mag", reason: "The device sends the field in arbitrary units." }],
};

function open(answers: Record<string, unknown>): readonly Asked[] {
  const asked = answering(answers);
  render(<RosTopics device={{ id: "1", name: "MTi-630" } as DeviceInfo} onClose={() => undefined} />);
  return asked;
}

test("topics of the device are shown with subscribers, rate and what it lacks", async () => {
  open({ "GET /api/ros2": STATE });
  const [item, ...others] = await screen.findAllByRole("listitem");
  expect(others).toEqual([]);
  expect(item?.textContent).toContain("2 subscribers · 100 Hz");
  expect(screen.getByRole("status").textContent).toContain("Router tcp/127.0.0.1:7447, domain 0. Connected.");
  expect(screen.getByRole("region", { name: "Not published" }).textContent).toContain("arbitrary units");
});

test("a topic is switched off", async () => {
  const off = { ...STATE, topics: [{ ...TOPIC, enabled: false }] };
  const asked = open({ "GET /api/ros2": STATE, "PATCH /api/ros2/topics": off });
  fireEvent.click(await screen.findByRole("switch", { name: "Publish /mti_630/imu/data" }));
  await vi.waitFor(() => expect(screen.getByRole<HTMLInputElement>("switch").checked).toBe(false));
  expect(asked.find(({ method }) => method === "PATCH")?.body).toEqual({ key: "1 imu/data", enabled: false });
});

test("a router that is away and a server without ROS 2 are told", async () => {
  open({ "GET /api/ros2": { ...STATE, connected: false, problem: "No router answers.", hint: "Start zenohd." } });
  expect((await screen.findByRole("status")).textContent).toContain("No router answers. Start zenohd.");
  cleanup();
  open({ "GET /api/ros2": { ...STATE, enabled: false } });
  expect(await screen.findByText(/Devices are not published/)).toBeTruthy();
});

test("a live device has a button that opens it", async () => {
  await openPage(recorded("xbus"), { answers: { "GET /api/ros2": STATE } });
  fireEvent.click(await screen.findByRole("button", { name: "ROS 2" }));
  expect((await screen.findByRole("dialog")).textContent).toContain("ROS 2 topics of");
});
