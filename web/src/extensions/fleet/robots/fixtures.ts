/** Robots for tests. */
import type { RobotDevice, RobotSummary } from "../../../wire/routes";

export function deviceWith(part: Partial<RobotDevice> = {}): RobotDevice {
  return {
    id: "1",
    name: "A-100",
    product: "A-100",
    serial_number: "0080001234",
    firmware: "1.12.0",
    protocol: "a",
    status: "live",
    rate: 400,
    expected_rate: 400,
    loss: 0,
    lost: 0,
    fix: "3D",
    temperature: 31.5,
    clock_ppm: 4.2,
    clock_ppm_uncertainty: 1.5,
    clock_uncertainty_ms: 0.2,
    settings: "",
    settings_read: null,
    more: {},
    ...part,
  };
}

export function robotWith(part: Partial<RobotSummary> = {}): RobotSummary {
  return {
    name: "amr-001",
    group: "Harbour",
    state: "live",
    since: 1_700_000_000,
    latency_ms: 21,
    version: "1.0.0",
    address: "http://amr-001.example:8080/",
    pages: "view",
    recording: false,
    disk_free_bytes: 2e11,
    settings: "as-profile",
    drifted: 0,
    same_name: 0,
    alarms: [],
    devices: [deviceWith()],
    more: {},
    ...part,
  };
}
