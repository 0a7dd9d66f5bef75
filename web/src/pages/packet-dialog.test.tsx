// @vitest-environment happy-dom
/** The packet view: the frame of a sample with the meaning of its bytes, its neighbours, and the way back to the plot. */
import { fireEvent, render, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import type { PacketAt } from "../page/context";
import { answering, type Asked } from "../testing/recorded";
import type { PacketInfo, PacketView } from "../wire/routes";
import { PacketDialog } from "./packet-dialog";

const NOW = 1_760_000_000;
const FRAME: PacketInfo = {
  kind: "frame",
  arrival: NOW,
  gap_ms: 10,
  rank: 0,
  size: 4,
  hex: "fa0102c8",
  name: "MTData2",
  title: "MTData2",
  protocol: "xbus",
  verdict: "Accepted: it has passed the checks of its protocol.",
  reason: "",
  doc: "Measured data.",
  source: "MT0101P 5.3.6",
  spans: [
    { offset: 0, size: 1, label: "preamble", path: "" },
    { offset: 1, size: 2, label: "PacketCounter: 258", path: "PacketCounter" },
    { offset: 3, size: 1, label: "checksum", path: "" },
  ],
  fields: { PacketCounter: 258 },
  flags: {},
};
const REJECT: PacketInfo = {
  ...FRAME,
  kind: "reject",
  arrival: NOW + 0.01,
  name: "",
  hex: "fa00",
  size: 2,
  verdict: "Rejected: the checksum does not match.",
  spans: [],
  fields: {},
};
const VIEW: PacketView = {
  device: "1",
  protocol: "xbus",
  at: 1,
  time: NOW - 0.002,
  packets: [{ ...FRAME, arrival: NOW - 0.01, gap_ms: null }, FRAME, REJECT, { ...FRAME, arrival: NOW + 0.02 }],
};

function open(at: Partial<PacketAt> = {}): {
  asked: readonly Asked[];
  pin: ReturnType<typeof vi.fn>;
  close: () => number;
} {
  const asked = answering({ "GET /api/devices/1/frames": VIEW, "GET /api/recordings/yard/frames": VIEW });
  const pin = vi.fn();
  const close = vi.fn();
  const what = { device: "1", time: NOW - 0.002, base: "device" as const, channel: 7, pin, ...at };
  render(<PacketDialog at={what} name="MTi-630" onClose={close} />);
  return { asked, pin, close: () => close.mock.calls.length };
}

test("the frame of a sample is shown byte by byte", async () => {
  const { asked } = open();
  await screen.findByText("PacketCounter: 258");
  expect(asked[0]?.path).toContain("/api/devices/1/frames");
  const rows = [...document.querySelectorAll("tbody tr")].map(({ textContent }) => textContent);
  expect(rows).toEqual(["0FApreamble", "101 02PacketCounter: 258258", "3C8checksum"]);
  const text = document.querySelector(".packet-frame")?.textContent ?? "";
  expect(text).toContain("10.000 ms after the one before");
  expect(text).toContain("Described in MT0101P 5.3.6.");
  expect(text).toContain("device time");
});

test("neighbours are reached by key and by press, rejected ones with the reason", async () => {
  open();
  await screen.findByText("PacketCounter: 258");
  fireEvent.keyDown(document.body, { key: "ArrowRight" });
  await screen.findByText(/the checksum does not match/);
  expect(screen.getByRole("heading", { name: "Rejected frame" })).toBeTruthy();
  fireEvent.click(screen.getByRole("button", { name: "Previous frame (←)" }));
  await screen.findByText("PacketCounter: 258");
});

test("a frame leads back to the plot, on the clock of the plot", async () => {
  const { pin, close } = open();
  await screen.findByText("PacketCounter: 258");
  fireEvent.keyDown(document.body, { key: "ArrowRight" });
  await screen.findByText(/the checksum does not match/);
  fireEvent.click(screen.getByRole("button", { name: "Show in plot" }));
  expect(pin.mock.calls[0]?.[0]).toBeCloseTo(NOW + 0.008, 6);
  expect(close()).toBe(1);
});

test("the hex is copied whole", async () => {
  const writeText = vi.fn(() => Promise.resolve());
  vi.stubGlobal("navigator", { clipboard: { writeText } });
  open();
  await screen.findByText("PacketCounter: 258");
  fireEvent.click(screen.getByRole("button", { name: "Copy hex" }));
  await waitFor(() => expect(writeText).toHaveBeenCalledWith("FA 01 02 C8"));
});

test("a recording is asked for its own frames", async () => {
  const { asked } = open({ recording: "yard" });
  await screen.findByText("PacketCounter: 258");
  expect(asked[0]?.path).toContain("/api/recordings/yard/frames");
});

test("the field of the point is marked, with its value in the unit of the plot", async () => {
  const sample = { name: "Packet counter", value: "258", message: "MTData2", at: 0, column: "value" };
  open({ sample: { ...sample, channel: "PacketCounter" } });
  const row = (await screen.findByText("PacketCounter: 258")).closest("tr");
  expect(row?.getAttribute("aria-current")).toBe("true");
  expect(document.querySelector(".packet-sample")?.textContent).toBe("In the plot: Packet counter 258");
  fireEvent.keyDown(document.body, { key: "ArrowLeft" });
  await waitFor(() => expect(document.querySelector(".packet-sample")).toBeNull()); // another frame has another one
});
