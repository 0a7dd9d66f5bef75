// @vitest-environment happy-dom
/** The form of a computed signal, opened from the tree of signals. */
import { fireEvent, screen, waitFor } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openPage } from "../../testing/live-page";
import { type Answers, recorded } from "../../testing/recorded";

const known = recorded("xbus");

async function openTree(answers: Answers): Promise<Opened> {
  const opened = await openPage(known, { answers });
  await screen.findByRole("button", { name: "All signals…" });
  fireEvent.keyDown(document.body, { key: "s", code: "KeyS" });
  await screen.findByRole("searchbox");
  return opened;
}

const FIGURES = [
  {
    signal: "(norm(Acceleration))",
    device: "1",
    units: { values: "m/s²" },
    figures: { values: [9.8, 9.9, null], n: 3 },
  },
];
const WORDS = { functions: [{ name: "norm", form: "norm(v)", doc: "Length of a vector." }], units: ["g"] };
const TOTAL = { name: "Total", expression: "norm(Acceleration)", unit: "m/s²", message: "", hint: "" };

async function openForm(answers: Answers): Promise<{ readonly opened: Opened; readonly input: HTMLElement }> {
  const opened = await openTree({ "GET /api/signals/words": WORDS, ...answers });
  fireEvent.click(screen.getByRole("button", { name: "New signal" }));
  return { opened, input: await screen.findByRole("combobox", { name: "Expression" }) };
}

test("an expression has a preview with its unit and first values, is saved under a name and plotted", async () => {
  const { opened, input } = await openForm({
    "POST /api/analysis/expression": FIGURES,
    "PUT /api/devices/1/signals/Total": TOTAL,
  });
  fireEvent.input(input, { target: { value: "norm(Acceleration)" } });
  expect(await screen.findByText(/9\.8000 9\.9000/)).toBeTruthy();
  fireEvent.input(screen.getByLabelText("Name"), { target: { value: "Total" } });
  fireEvent.keyDown(input, { key: "Enter" });
  await waitFor(() =>
    expect(opened.app.viewState.customPlots.value.map((plot) => plot.signals)).toEqual([
      [{ device: "1", channel: "Total", column: "value" }],
    ]),
  );
  const put = opened.asked.find(({ method }) => method === "PUT");
  expect(put?.body).toEqual({ expression: "norm(Acceleration)" });
});

test("Tab takes what is offered, and stays in the field", async () => {
  const { input } = await openForm({ "POST /api/analysis/expression": FIGURES });
  const field = input as HTMLInputElement;
  fireEvent.input(field, { target: { value: "Accel" } });
  await waitFor(() => expect(field.getAttribute("aria-expanded")).toBe("true"));
  expect(fireEvent.keyDown(field, { key: "Tab" })).toBe(false); // the browser does not leave it
  await waitFor(() => expect(field.value).toMatch(/^Acceleration/));
  expect(field.getAttribute("aria-expanded")).toBe("false");
  expect(fireEvent.keyDown(field, { key: "Tab" })).toBe(true); // nothing is offered: on to the next field
});

test("a mistake is marked where it is, with the server's sentence", async () => {
  const message = "Signal Foo not found. (character 7)"; // of "(norm(Foo))"
  const { input } = await openForm({
    "POST /api/analysis/expression": () =>
      Response.json({ kind: "bad-expression", message, hint: "Channels: Acceleration." }, { status: 422 }),
  });
  fireEvent.input(input, { target: { value: "norm(Foo)" } });
  expect(await screen.findByText(/Signal Foo not found\. \(character 6\) Channels: Acceleration\./)).toBeTruthy();
  expect(document.querySelector(".expression-place mark")?.textContent).toBe("Foo");
});
