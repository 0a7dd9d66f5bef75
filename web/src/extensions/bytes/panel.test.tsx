// @vitest-environment happy-dom
/** The panel of frames: the newest first, followed or held, and the way to the packet view. */
import { signal } from "@preact/signals";
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { afterEach, expect, test, vi } from "vitest";
import { createViewState } from "../../data/view-state";
import type { Deps } from "../../page/context";
import { answering } from "../../testing/recorded";
import type { Panel } from "../../ui/dom/dom";
import type { PacketInfo, PacketView } from "../../wire/routes";
import { mountBytes } from "./panel";

const NOW = 1_760_000_000;

function packet(arrival: number, more: Partial<PacketInfo> = {}): PacketInfo {
  const frame: PacketInfo = {
    ...{ kind: "frame", arrival, gap_ms: 10, rank: 0, size: 4, hex: "fa0102c8", name: "MTData2", title: "MTData2" },
    ...{ protocol: "xbus", verdict: "Accepted.", reason: "", doc: "", source: "", spans: [], fields: {}, flags: {} },
  };
  return { ...frame, ...more };
}

const view = (newest: number): PacketView => ({
  ...{ device: "1", protocol: "xbus", at: 2, time: null },
  packets: [
    packet(newest - 0.02),
    packet(newest - 0.01, { kind: "reject", name: "" }),
    packet(newest, { rank: 1 }),
    packet(newest + 0.01), // after the moment that is read
  ],
});

let panel: Panel | undefined;
let frames = 0;
/** A frame of the page, half a second after the last one. */
const frame = (): void => panel?.update((frames += 500));

afterEach(() => {
  panel?.dispose();
});

function open(recording?: string) {
  const now = { newest: NOW };
  const route = recording ? `GET /api/recordings/${recording}/frames` : "GET /api/devices/1/frames";
  const asked = answering({ [route]: (query: URLSearchParams) => view(Number(query.get("time"))) });
  const viewState = createViewState();
  viewState.view.value = { ...viewState.view.value, device: "1" };
  const packets = vi.fn();
  const store = {
    devices: signal([{ id: "1" }]),
    channels: signal([]),
    health: {
      get value() {
        return new Map([["1", { last_arrival: now.newest }]]);
      },
    },
    serverNow: () => NOW + 60,
    edgeOf: () => now.newest,
  };
  const deps = {
    store,
    viewState,
    open: { packet: packets },
    ...(recording ? { recording: { id: recording, rate: () => 0 } } : {}),
  };
  const host = document.body.appendChild(document.createElement("div"));
  panel = mountBytes(host, deps as unknown as Deps);
  return { now, asked, packets, viewState };
}

const rows = (): readonly string[] => screen.queryAllByRole("listitem").map((row) => row.textContent ?? "");

async function shown(): Promise<readonly string[]> {
  await waitFor(() => {
    frame();
    expect(rows().length).toBe(3);
  });
  return rows();
}

test("the newest frame is first, with its gap and bytes, and a rejected one says so", async () => {
  const { asked } = open();
  const [first, second] = await shown();
  expect(first).toContain("MTData2");
  expect(first).toContain("+10.00 ms");
  expect(first).toContain("FA 01 02 C8");
  expect(second).toContain("Rejected frame");
  expect(asked[0]?.path).toContain(`time=${NOW}`); // of the last byte: the device has been silent for a minute
  const count = asked.length;
  frame();
  expect(asked.length).toBe(count); // nothing has arrived since
});

test("it follows what arrives, and holds still to be read", async () => {
  const { now, asked } = open();
  await shown();
  now.newest = NOW + 1;
  await waitFor(() => {
    frame();
    expect(asked.at(-1)?.path).toContain(`time=${NOW + 1}`);
  });
  fireEvent.click(screen.getByRole("button", { name: "Hold" }));
  const count = asked.length;
  now.newest = NOW + 2;
  frame();
  expect(asked.length).toBe(count);
  fireEvent.click(await screen.findByRole("button", { name: "Follow" }));
  await waitFor(() => {
    frame();
    expect(asked.at(-1)?.path).toContain(`time=${NOW + 2}`);
  });
});

test("a frame opens its bytes", async () => {
  const { packets } = open();
  await shown();
  fireEvent.click(screen.getAllByRole("button", { name: /MTData2/ })[0] as HTMLElement);
  expect(packets.mock.calls[0]?.[0]).toMatchObject({ device: "1", time: NOW, base: "arrival", rank: 1 });
});

test("a row does not move away while it is pressed", async () => {
  const { now, asked } = open();
  const before = await shown();
  const pressed = vi.spyOn(document.body.firstElementChild as HTMLElement, "matches").mockReturnValue(true);
  now.newest = NOW + 1;
  frame();
  expect(asked.at(-1)?.path).toContain(`time=${NOW}`);
  pressed.mockReturnValue(false);
  frame();
  pressed.mockReturnValue(true); // before the answer is here
  await waitFor(() => expect(asked.at(-1)?.path).toContain(`time=${NOW + 1}`));
  const count = asked.length;
  await new Promise((resolve) => setTimeout(resolve, 30));
  expect(rows()).toEqual(before);
  pressed.mockReturnValue(false);
  frame();
  expect(asked.length).toBe(count + 1);
  await waitFor(() => expect(rows()).not.toEqual(before));
});

test("over a recording it reads the frames up to the reading position", async () => {
  const { asked, viewState } = open("yard");
  viewState.view.value = { ...viewState.view.value, live: false, end: NOW };
  viewState.cursor.value = { kind: "pinned", time: NOW - 5 };
  await shown();
  expect(asked.at(-1)?.path).toMatch(new RegExp(`recordings/yard/frames.*time=${NOW - 5}`));
});
