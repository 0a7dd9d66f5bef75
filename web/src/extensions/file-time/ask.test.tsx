// @vitest-environment happy-dom
/** Tables that are open to question: asked about when they are dropped or opened, one after the other. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type Coming, libraryOf } from "../../pages/recordings/library-store";
import { parse, route } from "../../page/route";
import { newApp } from "../../testing/live-page";
import { answering, type Answers } from "../../testing/recorded";
import { followTables } from "./ask";

const STATE = { reading: {}, is_chosen: false, is_table: true, about: "unit", problem: "" };
const COLUMN = { number: 1, heading: "time", name: "time", unit: "", group: "", axis: "", role: "time" };
const PREVIEW = {
  separator: ";",
  decimal: ",",
  skipped: 0,
  columns: [COLUMN, { ...COLUMN, number: 2, heading: "gx", name: "gx", unit: "rad/s", role: "value" }],
  clocks: { time: "time" },
  clock: "time",
  time_column: "time",
  units: [
    { unit: "s", rate: 1, is_plausible: true },
    { unit: "ms", rate: 1000, is_plausible: true },
  ],
  unit: "",
  rate: null,
  epoch: "",
  sure: "",
  sentences: [],
  times: [null],
  rows: [["0", 1.5]],
  about: "unit",
  problem: "open",
  hint: "",
  heading: ["time", "gx"],
  packet_stamp: "first",
};
const READ = { ...PREVIEW, about: "", unit: "ms", rate: 1000, times: [1.5e9], sentences: ["The axis is time in ms."] };
const EMPTY = { time_column: "", unit: "", date_order: "", rate: 0, packet_stamp: "", columns: {} };
const ANSWERS: Answers = {
  "GET /api/recordings/a/reading": STATE,
  "GET /api/recordings/b/reading": { ...STATE, about: "" },
  "POST /api/recordings/a/reading/preview": PREVIEW,
  [`POST /api/recordings/a/reading/preview ${JSON.stringify({ ...EMPTY, unit: "ms" })}`]: READ,
  "PUT /api/recordings/a/reading": { ...STATE, about: "" },
};

const stops: (() => void)[] = [];

beforeEach(() => {
  vi.spyOn(HTMLDialogElement.prototype, "showModal").mockImplementation(function (this: HTMLDialogElement) {
    this.open = true;
  });
  route.value = parse("#/recordings") ?? route.peek();
});

afterEach(() => {
  for (const stop of stops.splice(0)) stop();
});

function start() {
  const asked = answering(ANSWERS);
  const app = newApp();
  stops.push(followTables(app));
  return { asked, library: libraryOf(app) };
}

const coming = (key: number): Coming => ({ key, name: "a.csv", share: 0, problem: undefined, cancel: () => undefined });

test("a dropped table is shown with the question, and read as chosen", async () => {
  const { asked, library } = start();
  library.coming.value = [coming(1)];
  library.selected.value = "a";
  library.coming.value = [];
  await screen.findByText(/The unit of time is not certain/);
  expect(screen.getByText(/semicolons · decimal comma/)).toBeTruthy();
  expect(screen.getByText<HTMLButtonElement>("Read it so").disabled).toBe(true);
  fireEvent.click(screen.getByText("1 kHz"));
  await screen.findByText("The axis is time in ms.");
  fireEvent.click(screen.getByText("Read it so"));
  await waitFor(() => expect(route.peek().recording).toBe("a"));
  expect(asked.find(({ method }) => method === "PUT")?.body).toEqual({ ...EMPTY, unit: "ms" });
  expect(document.querySelector(".table-reading")).toBeNull();
});

test("a table that is opened and certain, and an upload that failed, are not asked about", async () => {
  const { asked, library } = start();
  const problem = { kind: "cut", message: "Upload incomplete.", hint: "", status: 400 };
  library.selected.value = "a";
  library.coming.value = [{ ...coming(1), problem }];
  library.coming.value = [];
  route.value = parse("#/recordings/b") ?? route.peek();
  await waitFor(() => expect(asked.map(({ path }) => path)).toEqual(["/api/recordings/b/reading"]));
  expect(document.querySelector(".table-reading")).toBeNull();
});

test("the end of a packet that its time belongs to is chosen", async () => {
  const { asked } = start();
  route.value = parse("#/recordings/a") ?? route.peek();
  fireEvent.click(await screen.findByText("last sample"));
  await waitFor(() => expect(asked.at(-1)?.body).toEqual({ ...EMPTY, packet_stamp: "last" }));
});

test("columns are renamed and left out, and rows counted", async () => {
  const { asked } = start();
  route.value = parse("#/recordings/a") ?? route.peek();
  fireEvent.change(await screen.findByLabelText("Name of gx"), { target: { value: "gyr.x" } });
  fireEvent.change(screen.getByLabelText("Unit of gx"), { target: { value: "°/s" } });
  const sent = () => asked.filter(({ method }) => method === "POST").at(-1)?.body;
  await waitFor(() => expect(sent()).toEqual({ ...EMPTY, columns: { "2": "gyr.x (°/s)" } }));
  fireEvent.click(screen.getByLabelText("gx"));
  fireEvent.change(screen.getByLabelText("Time column"), { target: { value: "none" } });
  fireEvent.input(screen.getByLabelText("Samples per second"), { target: { value: "12,5" } });
  await waitFor(() => expect(sent()).toEqual({ ...EMPTY, time_column: "none", rate: 12.5, columns: { "2": "" } }));
  fireEvent.click(screen.getByText("Cancel"));
  await waitFor(() => expect(document.querySelector(".table-reading")).toBeNull());
});
