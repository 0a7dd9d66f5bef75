// @vitest-environment happy-dom
/** A library of many recordings: its order, its selection, and what it costs. */
import { fireEvent, screen, waitFor, within } from "@testing-library/preact";
import { beforeEach, expect, test, vi } from "vitest";
import * as filter from "../../recordings/library-filter";
import { type Opened, openPage } from "../../testing/live-page";
import { type Answers, recorded } from "../../testing/recorded";
import { find } from "../../testing/queries";
import type { RecordingInfo } from "../../wire/recording-types";

beforeEach(() => localStorage.clear());

const LIBRARY = recorded("library");
const [YARD] = LIBRARY.answers["GET /api/recordings"] as readonly RecordingInfo[];
/** Recordings of consecutive minutes, the newest first. */
const many = (n: number): readonly RecordingInfo[] =>
  Array.from({ length: n }, (_, i) => ({
    ...(YARD as RecordingInfo),
    ...{
      id: `run-${i}`,
      title: `Run ${i}`,
      file: `run-${i}.mcap`,
      started: 1_795_000_000 - 60 * i,
      size: 1000 + ((i * 7) % n),
    },
    ...{ notes: i % 50 === 3 ? "Tyre swapped" : "", tags: i % 2 ? ["yard"] : [], damaged: "", deleted: null },
    ...{ read: true, motion: "|a|", thumbnail: [[0.4, 0.6]], losses: [0.5], marks: [] },
  }));
const rows = (): readonly HTMLElement[] => [...document.querySelectorAll<HTMLElement>("tr[aria-rowindex]")];
const titles = (): readonly string[] => rows().map((row) => row.querySelector("b")?.textContent ?? "");
const picked = (): readonly string[] =>
  [...document.querySelectorAll("tr[aria-selected=true] b")].map(({ textContent }) => textContent ?? "");
const row = (title: string): HTMLElement => {
  const found = rows().find((one) => one.querySelector("b")?.textContent === title);
  if (!found) throw new Error(`no row ${title}`);
  return found;
};
const head = (name: string): HTMLElement => within(find("thead")).getByRole("button", { name });
const key = (name: string, more: KeyboardEventInit = {}): void =>
  void fireEvent.keyDown(find("table"), { key: name, ...more });

async function open(list: readonly RecordingInfo[], more: Answers = {}): Promise<Opened> {
  const answers = { ...LIBRARY.answers, "GET /api/recordings": list, ...more };
  const page = await openPage({ ...LIBRARY, answers }, { place: "#/recordings" });
  await waitFor(() => expect(rows().length).toBeGreaterThan(0));
  return page;
}

test("heads sort, and the browser keeps the order", async () => {
  await open(many(5));
  expect(titles()).toEqual(["Run 0", "Run 1", "Run 2", "Run 3", "Run 4"]);
  expect(head("Recorded").closest("th")?.getAttribute("aria-sort")).toBe("descending");
  fireEvent.click(head("Recorded"));
  await waitFor(() => expect(titles()[0]).toBe("Run 4"));
  fireEvent.click(head("Size"));
  await waitFor(() => expect(titles()).toEqual(["Run 2", "Run 4", "Run 1", "Run 3", "Run 0"]));
  expect(head("Size").closest("th")?.getAttribute("aria-sort")).toBe("descending");
  expect(head("Recorded").closest("th")?.getAttribute("aria-sort")).toBe("none");
  expect(JSON.parse(localStorage.getItem("imuscope.library") ?? "")).toMatchObject({ by: "size", isDescending: true });
});

test("columns are chosen", async () => {
  await open(many(2));
  expect(screen.queryByRole("button", { name: "Markers" })).toBeNull();
  const choice = within(find(".column-choice"));
  fireEvent.click(choice.getByLabelText("Markers"));
  fireEvent.click(choice.getByLabelText("Tags"));
  await waitFor(() => expect(head("Markers")).toBeTruthy());
  expect(document.querySelector("th[data-column=tags]")).toBeNull();
  fireEvent.click(choice.getByRole("button", { name: "Usual columns" }));
  await waitFor(() => expect(document.querySelector("th[data-column=tags]")).not.toBeNull());
});

test("of 2,000 recordings only the rows on screen are made, and a key reads each text once", async () => {
  const made = vi.spyOn(filter, "flaw");
  const { app } = await open(many(2000));
  const rendered = rows().length;
  expect(rendered).toBeLessThan(60);
  expect(find("table").getAttribute("aria-rowcount")).toBe("2001");
  expect(made.mock.calls.length).toBeLessThan(5 * rendered);
  expect(find(".recording-list").querySelectorAll("*").length).toBeLessThan(40 * rendered);
  const type = async (text: string, first: string): Promise<void> => {
    fireEvent.input(screen.getByRole("searchbox"), { target: { value: text } });
    await waitFor(() => expect(titles()[0]).toBe(first));
  };
  await type("tyre", "Run 3");
  expect(find("table").getAttribute("aria-rowcount")).toBe("41");
  const lowered = vi.spyOn(String.prototype, "toLowerCase");
  await type("tyre 103", "Run 103");
  expect(lowered.mock.calls.length).toBeLessThan(200); // the texts of all were made once
  lowered.mockRestore();
  await type("", "Run 0");
  const list = find(".recording-list");
  Object.defineProperty(list, "scrollTop", { value: 57 * 1000, configurable: true });
  fireEvent.scroll(list);
  await waitFor(() => expect(titles()).toContain("Run 1000"));
  expect(rows().length).toBeLessThan(60);
  app.stop();
});

test("rows are selected as in a file manager, by pointer and by keys", async () => {
  await open(many(8));
  fireEvent.click(row("Run 1"));
  await waitFor(() => expect(picked()).toEqual(["Run 1"]));
  expect(document.querySelector(".selection-bar")).toBeNull();
  fireEvent.click(row("Run 4"), { shiftKey: true });
  await waitFor(() => expect(picked()).toEqual(["Run 1", "Run 2", "Run 3", "Run 4"]));
  fireEvent.click(row("Run 2"), { ctrlKey: true });
  fireEvent.click(row("Run 6"), { ctrlKey: true });
  await waitFor(() => expect(picked()).toEqual(["Run 1", "Run 3", "Run 4", "Run 6"]));
  expect(find(".selection-bar").textContent).toContain("4 recordings selected");
  key("Escape");
  await waitFor(() => expect(picked()).toEqual([]));
  key("Home");
  key("ArrowDown");
  key("ArrowDown", { shiftKey: true });
  await waitFor(() => expect(picked()).toEqual(["Run 1", "Run 2"]));
  expect(find("table").getAttribute("aria-activedescendant")).toBe("recording-run-2");
  key(" ");
  await waitFor(() => expect(picked()).toEqual(["Run 1"]));
  key("a", { ctrlKey: true });
  await waitFor(() => expect(picked().length).toBe(8));
  key("End");
  key("Enter");
  await waitFor(() => expect(location.hash).toBe("#/recordings/run-7"));
});

test("several are compared, tagged, exported, deleted and restored together", async () => {
  const list = many(4);
  const changed = Object.fromEntries(
    list.flatMap((info) => [
      [`PATCH /api/recordings/${info.id}`, { ...info, tags: ["mast"] }],
      [`DELETE /api/recordings/${info.id}`, { ...info, deleted: 5 }],
      [`POST /api/recordings/${info.id}/undelete`, info],
      [
        `POST /api/recordings/${info.id}/exports`,
        { id: 1, state: "waiting", recording: info.id, title: "", message: "", hint: "" },
      ],
    ]),
  );
  const { asked } = await open(list, changed);
  const paths = (method: string): readonly string[] =>
    asked.filter((one) => one.method === method).map(({ path }) => path.replace("/api/recordings/", ""));
  fireEvent.click(row("Run 1"));
  fireEvent.click(row("Run 2"), { ctrlKey: true });
  const bar = within(await waitFor(() => find(".selection-bar")));
  expect(bar.getByRole("link", { name: "Compare" }).getAttribute("href")).toBe("#/recordings?a=run-1&b=run-2");
  const field = bar.getByLabelText("Tag all, Enter");
  fireEvent.input(field, { target: { value: "mast" } });
  fireEvent.submit(find(".selection-bar form"));
  await waitFor(() => expect(paths("PATCH")).toEqual(["run-1", "run-2"]));
  expect(asked.find(({ method }) => method === "PATCH")?.body).toEqual({ tags: ["yard", "mast"] });
  fireEvent.click(bar.getByRole("button", { name: "Export all" }));
  await waitFor(() => expect(paths("POST")).toEqual(["run-1/exports", "run-2/exports"]));
  fireEvent.click(bar.getByRole("button", { name: "Delete" }));
  await waitFor(() => expect(titles()).toEqual(["Run 0", "Run 3"]));
  expect(find(".library-centre .band").textContent).toContain("2 recordings deleted");
  fireEvent.click(screen.getByRole("button", { name: "Undo" }));
  await waitFor(() => expect(titles().length).toBe(4));
});

test("what was not read yet is a state of its own, and no loss", async () => {
  const [a, b] = many(2) as [RecordingInfo, RecordingInfo];
  await open([a, { ...b, read: false, opened: false, thumbnail: [], losses: [] }]);
  expect(row("Run 0").querySelector("canvas")?.getAttribute("aria-label")).toMatch(
    /^\|a\| over the recording, samples lost in/,
  );
  expect(row("Run 1").querySelector("canvas")).toBeNull();
  expect(row("Run 1").textContent).toContain("not read yet");
  expect(row("Run 1").querySelector("[data-column=loss]")?.textContent).toBe("");
  const filters = within(find("#rail"));
  expect(filters.getByRole("button", { name: "With loss 1" })).toBeTruthy();
  fireEvent.click(filters.getByRole("button", { name: "Not read yet 1" }));
  await waitFor(() => expect(titles()).toEqual(["Run 1"]));
});

test("the foot names the recordings' share of the disk, its free space and the quota", async () => {
  await open(many(1), { "GET /api/recorder/storage": { used: 2e9, free: 6e9, quota: 4e9 } });
  await waitFor(() => expect(find(".storage").textContent).toBe("Recordings 2.00 GB6.00 GB freeQuota 4.00 GB"));
  expect(find(".storage progress").getAttribute("value")).toBe("2000000000");
  expect(find(".storage progress").getAttribute("max")).toBe("4000000000");
});
