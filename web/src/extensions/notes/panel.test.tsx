// @vitest-environment happy-dom
/** Notes of a recording: times that lead into the plots, and what is shown where two people write at once. */
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp } from "../../testing/live-page";
import { answering } from "../../testing/recorded";
import { clock } from "../../ui/format/format";
import { mountNotes } from "./panel";

type Send = (body: unknown) => void;

const listed = (notes: string) => [{ id: "yard", started: 0, notes }];
const [START, LENGTH] = [1_760_000_000, 8];
const write = (value: string): void => void fireEvent.input(screen.getByRole("textbox"), { target: { value } });

/** The panel of an open recording, over plots that have a sample at every moment. */
function open() {
  const app = newApp();
  app.viewState.actions.attachPlots({
    now: () => START + LENGTH,
    bounds: () => ({ first: START, last: START + LENGTH }),
    step: () => undefined,
    nearest: (t) => t,
    plots: () => [],
    series: () => [],
    beside: () => [],
  });
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  mountNotes(host, { ...app, recording: { id: "yard", rate: () => 0 } });
  return app.viewState;
}

test("the range between the cursors is inserted, saved, and leads into the plots", async () => {
  const range = `[${clock(START + 2, 3)} – ${clock(START + 3, 3)}]`;
  const asked = answering({
    "GET /api/recordings": listed(""),
    "PATCH /api/recordings/yard": { id: "yard", notes: `Turn ${range}` },
  });
  const { actions, view, cursor, measure } = open();
  await screen.findByText("No notes yet.");
  actions.pin(START + 2);
  actions.pinMeasure(START + 3);
  fireEvent.click(screen.getByText("Write notes"));
  write("Turn");
  const field = screen.getByRole<HTMLTextAreaElement>("textbox");
  field.setSelectionRange(4, 4);
  fireEvent.click(await screen.findByText("Insert A to B"));
  expect(field.value).toBe(`Turn ${range} `);
  fireEvent.click(screen.getByText("Save"));
  const time = await screen.findByText(range.slice(1, -1));
  expect(asked.at(-1)).toMatchObject({ method: "PATCH", body: { notes: `Turn ${range} `, notes_before: "" } });
  actions.fit();
  actions.pin(START);
  fireEvent.click(time);
  expect(view.value.span).toBeCloseTo(1.5, 6); // the range and some room
  expect(cursor.value).toEqual({ kind: "pinned", time: expect.closeTo(START + 2, 3) });
  expect(measure.value).toBeCloseTo(START + 3, 3);
});

test("notes that somebody changed meanwhile are shown below one's own, and both are combined", async () => {
  let isChanged = false;
  const changed = { kind: "changed", message: "The notes were changed elsewhere.", hint: "" };
  const asked = answering({
    "GET /api/recordings": () => listed(isChanged ? "Turn" : ""),
    "PATCH /api/recordings/yard": () => Response.json(changed, { status: 412 }),
  });
  open();
  fireEvent.click(await screen.findByText("Write notes"));
  write("Dry road");
  isChanged = true;
  fireEvent.click(screen.getByText("Save"));
  await screen.findByText("The notes were changed elsewhere.");
  await screen.findByText("Turn", { selector: ".notes-theirs" });
  expect(screen.getByRole<HTMLTextAreaElement>("textbox").value).toBe("Dry road");
  const both = "Turn\nDry road";
  const stored = answering({
    "GET /api/recordings": listed(both),
    "PATCH /api/recordings/yard": { id: "yard", notes: both },
  });
  write(both);
  fireEvent.keyDown(screen.getByRole("textbox"), { key: "Enter", ctrlKey: true });
  await vi.waitFor(() => expect(document.querySelector(".notes-text")?.textContent).toBe(both));
  expect(stored[0]).toMatchObject({ method: "PATCH", body: { notes: both, notes_before: "Turn" } });
  expect(asked.filter(({ method }) => method === "PATCH").map(({ body }) => body)).toEqual([
    { notes: "Dry road", notes_before: "" },
  ]);
});

/** A server whose answers are given by hand, in any order. */
function heldServer() {
  const held: Record<"GET" | "PATCH", Send[]> = { GET: [], PATCH: [] };
  vi.stubGlobal(
    "fetch",
    (path: string, { method = "GET" }: RequestInit = {}) =>
      new Promise<Response>((resolve) => {
        if (path.startsWith("/api/recordings"))
          held[method as "GET" | "PATCH"].push((body) => resolve(Response.json(body)));
      }),
  );
  const next = async (method: "GET" | "PATCH"): Promise<Send> => {
    await vi.waitFor(() => expect(held[method]).not.toHaveLength(0));
    return held[method].shift() as Send;
  };
  return { held, next };
}

test("an answer that was overtaken by what was saved is not shown", async () => {
  const server = heldServer();
  const app = newApp();
  const host = document.createElement("div");
  document.body.replaceChildren(host);
  mountNotes(host, { ...app, recording: { id: "yard", rate: () => 0 } });
  (await server.next("GET"))(listed("Dry"));
  await screen.findByText("Dry");

  app.store.receive({ kind: "text", text: { op: "library" } as never }); // somebody renamed another recording
  const late = await server.next("GET");
  fireEvent.click(screen.getByText("Edit"));
  fireEvent.input(screen.getByRole("textbox"), { target: { value: "Wet" } });
  fireEvent.click(screen.getByText("Save"));
  (await server.next("PATCH"))({ id: "yard", notes: "Wet" });
  await screen.findByText("Wet");
  late(listed("Dry"));
  await new Promise((resolve) => setTimeout(resolve));
  expect(screen.queryByText("Wet")).not.toBeNull();

  fireEvent.click(screen.getByText("Edit"));
  app.store.receive({ kind: "text", text: { op: "library" } as never }); // not looked at while one writes
  fireEvent.click(screen.getByText("Cancel"));
  await vi.waitFor(() => {
    server.held.GET.splice(0).forEach((send) => send(listed("Wet and cold"))); // the last one counts
    expect(screen.queryByText("Wet and cold")).not.toBeNull();
  });
  cleanup();
});
