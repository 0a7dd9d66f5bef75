// @vitest-environment happy-dom
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../../testing/live-page";
import { recorded } from "../../testing/recorded";
import { find } from "../../testing/queries";

const TITLE = "Yard loop";

const rows = (): readonly HTMLElement[] => [...document.querySelectorAll<HTMLElement>(".recording-list tbody tr")];
const search = (words: string): void =>
  void fireEvent.input(screen.getByRole("searchbox"), { target: { value: words } });

/** The library with its only recording selected. */
async function openLibrary(library = recorded("library")): Promise<Opened> {
  const page = await openPage(library, { place: "#/recordings" });
  await waitFor(() => expect(rows().length).toBe(1));
  const [row] = rows();
  if (row) fireEvent.click(row);
  await waitFor(() => expect(find(".detail").textContent).toContain("Length"));
  return page;
}

test("a recording is found by matching words only", async () => {
  const { asked } = await openLibrary();
  fireEvent.input(find(".words form input"), { target: { value: "mast" } });
  fireEvent.submit(find(".words form"));
  await waitFor(() => expect(find(".tag-cloud").textContent).toContain("mast"));
  expect(asked.find(({ method }) => method === "PATCH")?.body).toEqual({ tags: ["mast"] });
  search("mast yard");
  await waitFor(() => expect(rows().length).toBe(1));
  expect(rows()[0]?.textContent).toContain(TITLE);
  search("nowhere");
  await waitFor(() => expect(find(".library-centre").textContent).toContain("No matches"));
  search("");
  await waitFor(() => expect(rows().length).toBe(1));
});

test("a tag that is added while another one is being stored does not undo it", async () => {
  const library = recorded("library");
  const [listed] = library.answers["GET /api/recordings"] as readonly object[];
  let kept: object | undefined;
  const stores = (tags: readonly string[]) => ({
    [`PATCH /api/recordings/yard ${JSON.stringify({ tags })}`]: () => (kept = { ...listed, tags }),
  });
  const answers = { ...library.answers, ...stores(["mast"]), ...stores(["hill"]), ...stores(["mast", "hill"]) };
  await openLibrary({ ...library, answers });
  for (const word of ["mast", "hill"]) {
    fireEvent.input(find(".words form input"), { target: { value: word } });
    fireEvent.submit(find(".words form"));
  }
  await waitFor(() => expect(find(".words .tags").textContent).toContain("hill"));
  expect(kept).toMatchObject({ tags: ["mast", "hill"] });
});

test("what is left out of a file is said, and is no damage", async () => {
  const library = recorded("library");
  const listed = library.answers["GET /api/recordings"] as readonly object[];
  const remark = "Columns without numbers are left out: label ('walking').";
  const answers = { ...library.answers, "GET /api/recordings": listed.map((one) => ({ ...one, remark })) };
  await openLibrary({ ...library, answers });
  expect(find(".detail > .hint").textContent).toBe(remark);
  expect(document.querySelector(".detail .problem")).toBeNull();
  expect(rows()[0]?.textContent).not.toContain("damaged");
});

test("a recording is opened by a double click on its row", async () => {
  await openLibrary();
  const [row] = rows();
  if (row) fireEvent.dblClick(row);
  await waitFor(() => expect(location.hash).toMatch(/^#\/recordings\/yard/));
});

test("a deleted recording leaves the list and is restored", async () => {
  const { asked } = await openLibrary();
  fireEvent.click(screen.getByRole("button", { name: "Delete" }));
  await waitFor(() => expect(find(".library-centre").textContent).toContain(`${TITLE} deleted`));
  expect(rows().length).toBe(0);
  fireEvent.click(screen.getByRole("button", { name: "Undo" }));
  await waitFor(() => expect(document.querySelector(".recording-list tbody tr b a")).not.toBeNull());
  expect(asked.filter(({ path }) => path.endsWith("/yard")).map(({ method }) => method)).toEqual(["DELETE"]);
  expect(asked.filter(({ path }) => path.endsWith("/yard/undelete")).length).toBe(1);
});
