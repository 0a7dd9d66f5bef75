// @vitest-environment happy-dom
/** Time controls and markers of an open recording. */
import { fireEvent, render, screen, waitFor, within } from "@testing-library/preact";
import { expect, test } from "vitest";
import { createViewState } from "../../data/view-state";
import { ReplayController } from "../../recordings/replay-controller";
import type { RecordingDetail } from "../../wire/recording-types";
import { newApp } from "../../testing/live-page";
import { answering, type Answers, type Asked } from "../../testing/recorded";
import { Markers } from "./markers";
import { openRecording } from "./open-recording";
import { Transport } from "./transport";

const FIRST = 1000;
const KERB = { id: "k", time: FIRST + 20, kind: "marker", text: "kerb", device: "" };

function open(answers: Answers = {}): { readonly replay: ReplayController; readonly asked: readonly Asked[] } {
  const detail = {
    info: { id: "yard", title: "Yard", started: FIRST },
    t0: FIRST,
    t1: FIRST + 60,
    devices: [{ id: "1", name: "one" }],
    channels: [],
    events: [],
    markers: [KERB],
    snapshots: {},
    longest_s: {},
    progress: 1,
    begins: {},
  } as unknown as RecordingDetail;
  const asked = answering(answers);
  const replay = new ReplayController(detail, { hide: [], show: [], panels: [] }, createViewState());
  const recording = openRecording(replay, newApp());
  render(
    <>
      <Markers recording={recording} />
      <Transport recording={recording} />
    </>,
  );
  return { replay, asked };
}
const button = (name: string | RegExp): HTMLElement => screen.getByRole("button", { name });
const list = (): readonly string[] => [...document.querySelectorAll(".markers li")].map((one) => one.textContent ?? "");

test("it plays, stops, loops the visible range and changes speed", async () => {
  const { replay } = open();
  fireEvent.click(button("Play"));
  expect(replay.playing.value).toBe(true);
  await waitFor(() => button("Pause"));
  fireEvent.change(screen.getByRole("combobox", { name: "Speed" }), { target: { value: "5" } });
  for (let ms = 0; ms <= 1000; ms += 100) replay.tick(ms);
  expect(replay.head).toBeCloseTo(FIRST + 5, 3);
  fireEvent.click(button("Pause"));
  expect(replay.playing.value).toBe(false);
  replay.viewState.actions.select(FIRST + 10, FIRST + 20);
  fireEvent.click(button(/^Loop/));
  await waitFor(() => expect(button(/^Loop/).getAttribute("aria-pressed")).toBe("true"));
  expect(replay.loop.value).toEqual([FIRST + 10, FIRST + 20]);
  replay.dispose();
});

test("a press on a marker goes there", () => {
  const { replay } = open();
  expect(list()).toEqual([expect.stringContaining("kerb")]);
  fireEvent.click(within(screen.getByRole("region", { name: "Markers" })).getByText("kerb"));
  expect(replay.head).toBe(KERB.time);
  replay.dispose();
});

test("an added marker is at the playhead, has its text, and is in order", async () => {
  const later = { id: "n", time: FIRST + 5, kind: "marker", text: "second look", device: "" };
  const { replay, asked } = open({ "POST /api/recordings/yard/markers": later });
  replay.seek(FIRST + 5);
  fireEvent.click(button("Add a marker here"));
  const field = await screen.findByPlaceholderText<HTMLInputElement>(/^Marker at 00:05/);
  expect(document.activeElement).toBe(field);
  fireEvent.input(field, { target: { value: " second look " } });
  fireEvent.submit(field.form as HTMLFormElement);
  await waitFor(() => expect(list().length).toBe(2));
  expect(list()[0]).toContain("second look");
  expect(asked.find(({ method }) => method === "POST")?.body).toEqual({
    text: "second look",
    kind: "marker",
    time: FIRST + 5,
    device: "",
  });
  expect(screen.queryByPlaceholderText(/^Marker at/)).toBeNull();
  replay.dispose();
});

test("Esc adds no marker", async () => {
  const { replay, asked } = open();
  fireEvent.click(button("Marker"));
  const field = await screen.findByPlaceholderText(/^Marker at/);
  fireEvent.keyDown(field, { key: "Escape" });
  await waitFor(() => expect(screen.queryByPlaceholderText(/^Marker at/)).toBeNull());
  expect(asked.filter(({ method }) => method === "POST")).toEqual([]);
  replay.dispose();
});
