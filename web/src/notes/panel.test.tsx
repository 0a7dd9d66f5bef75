// @vitest-environment happy-dom
/** Notes that are read and saved at once: what was saved last is shown, whatever answer comes last. */
import { cleanup, fireEvent, screen } from "@testing-library/preact";
import { expect, test, vi } from "vitest";
import { newApp } from "../testing/live-page";
import { mountNotes } from "./panel";

type Send = (body: unknown) => void;

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

const listed = (notes: string) => [{ id: "yard", started: 0, notes }];

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
