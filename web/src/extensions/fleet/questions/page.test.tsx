// @vitest-environment happy-dom
/** The page of questions: completion by keys, the place of a mistake, sorting, a link, and a question that is cancelled. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { openPage } from "../../../testing/live-page";
import { type Answers, recorded } from "../../../testing/recorded";
import { questionsOf } from "./state";

const column = (name: string) => ({ name, type: "text", doc: "" });
const ANSWER = {
  columns: [
    { name: "recording", kind: "text" },
    { name: "mean", kind: "number" },
  ],
  rows: [
    ["drive", 2],
    ["drive", -1],
    ["drive", 10],
  ],
  more: false,
  seconds: 0.1,
};
const STORE: Answers = {
  "GET /api/query": { store: "/srv/store", questions: [] },
  "GET /api/query/questions": [{ name: "lost", title: "samples lost", sql: "SELECT 1" }],
  "GET /api/query/tables": {
    tables: [{ name: "recordings", doc: "", columns: [column("recording"), column("robot")] }],
    signals: [],
    functions: [],
  },
};

async function open(answers: Answers = {}, place = "#/questions") {
  const page = await openPage(recorded("library"), { place, answers: { ...STORE, ...answers } });
  const field = await screen.findByLabelText<HTMLTextAreaElement>("Question in SQL");
  await screen.findByText(/Recordings in \/srv\/store/);
  return { ...page, field };
}

function ask(field: HTMLTextAreaElement, sql: string): void {
  fireEvent.input(field, { target: { value: sql } });
  fireEvent.keyDown(field, { key: "Enter", ctrlKey: true });
}
const status = (): string => document.querySelector(".question-status")?.textContent ?? "";

test("a word is completed by keys", async () => {
  const { field, asked } = await open();
  await waitFor(() => expect(asked.some(({ path }) => path === "/api/query/tables")).toBe(true));
  const options = (): readonly Element[] => [...document.querySelectorAll("#question-words [role=option]")];
  await waitFor(() => {
    fireEvent.input(field, { target: { value: "SELECT * FROM recor" } });
    expect(options()[0]?.textContent).toMatch(/^recordings/);
  });
  await waitFor(() => {
    fireEvent.keyDown(field, { key: "ArrowDown" }); // the list is opened again when the words have come
    expect(field.getAttribute("aria-activedescendant")).toBe(options()[0]?.id);
  });
  fireEvent.keyDown(field, { key: "Enter" });
  await waitFor(() => expect(field.value).toBe("SELECT * FROM recordings"));
  await waitFor(() => expect(options()).toEqual([]));
});

test("a mistake is marked at the place that the server names", async () => {
  const problem = { kind: "bad-query", message: "Line 1, column 8: there is no column robto.", hint: "" };
  const { field } = await open({ "POST /api/query": () => Response.json(problem, { status: 422 }) });
  ask(field, "SELECT robto\nFROM recordings");
  await waitFor(() => expect(document.querySelector(".question-mistake mark")?.textContent).toBe("robto"));
  expect(document.getElementById("question-problem")?.textContent).toContain("Line 1, column 8");
  expect(field.getAttribute("aria-invalid")).toBe("true");
});

test("an answer is sorted by its headings, and the address shows the question to another person", async () => {
  const { field } = await open({ "POST /api/query": ANSWER });
  ask(field, "SELECT recording, mean FROM minutes");
  const means = (): readonly (string | null)[] =>
    [...document.querySelectorAll(".answer-table tbody td:nth-child(2)")].map(({ textContent }) => textContent);
  await waitFor(() => expect(means()).toEqual(["2", "-1", "10"]));
  fireEvent.click(screen.getByRole("button", { name: "mean" }));
  await waitFor(() => expect(means()).toEqual(["-1", "2", "10"]));
  fireEvent.click(screen.getByRole("button", { name: "mean" }));
  await waitFor(() => expect(means()).toEqual(["10", "2", "-1"]));
  expect(document.querySelector("th[aria-sort=descending]")?.textContent).toBe("mean");
  const { hash } = location;
  const other = await open({}, hash);
  await waitFor(() => expect(other.field.value).toBe("SELECT recording, mean FROM minutes"));
});

test("a question that takes long says so, is cancelled, and another one is asked", async () => {
  const { field } = await open({ "POST /api/query": ANSWER });
  const { fetch } = globalThis;
  const isCancelled = vi.fn();
  vi.stubGlobal("fetch", (path: string, init: RequestInit = {}) =>
    path === "/api/query" && init.method === "POST"
      ? new Promise((_, reject) =>
          init.signal?.addEventListener("abort", () => {
            isCancelled();
            reject(new DOMException("cancelled", "AbortError"));
          }),
        )
      : fetch(path, init),
  );
  ask(field, "SELECT sum(a.range) FROM range(1000000000) a");
  await waitFor(() => expect(status()).toMatch(/^Running for \d+ s/));
  fireEvent.click(screen.getByRole("button", { name: "Cancel" }));
  await waitFor(() => expect(status()).toBe("Cancelled."));
  expect(isCancelled).toHaveBeenCalledOnce();
  vi.stubGlobal("fetch", fetch);
  ask(field, "SELECT 42");
  await waitFor(() => expect(status()).toBe("3 rows in 0.1 s"));
});

test("a file that is cut off on its way is told in words", async () => {
  const { app } = await open();
  const cut = Object.assign(new Response("a"), { blob: () => Promise.reject(new TypeError()) });
  vi.stubGlobal("fetch", async () => cut);
  const state = questionsOf(app);
  state.sql.value = "SELECT 1";
  expect(await state.file("csv")).toBeUndefined();
  expect(state.problem.value?.message).not.toBe("");
});
