// @vitest-environment happy-dom
/** Every form of every family. */
import { act, cleanup, fireEvent, render, screen } from "@testing-library/preact";
import { expect, test } from "vitest";
import { type Opened, openConfigure } from "../../testing/configure-page";
import type { Family } from "../../testing/recorded";
import { modelOf } from "./model";
import { Centre } from "./page";
import { find } from "../../testing/queries";

/** A page keeps what it has drawn of a form, some 2 MB here: after this many forms there is a new one. */
const AT_ONCE = 60;

/** The page without the list of all forms, which would be drawn again for each. */
async function shown(family: Family): Promise<Opened> {
  const opened = await openConfigure(family);
  fireEvent.click(screen.getByRole("button", { name: "All" }));
  cleanup();
  render(<Centre app={opened.app} model={modelOf("1", opened.app)} />);
  return opened;
}

test.each<Family>(["xbus", "isb", "idtp"])(
  "every setting and command of %s opens as a form with all of its fields",
  async (family) => {
    const wrong: string[] = [];
    const { forms, goTo: first } = await shown(family);
    let n = 0;
    let goTo = first;
    const open = async (
      kind: string,
      { name, title }: { name: string; title: string },
      fields: number | undefined,
    ): Promise<void> => {
      if (++n % AT_ONCE === 0) {
        cleanup();
        document.body.replaceChildren();
        ({ goTo } = await shown(family));
      }
      void act(() => goTo(encodeURIComponent(name)));
      const place = `[data-${kind}="${name}"]`;
      find(place);
      expect(find("h1").textContent).toBe(title);
      const drawn = document.querySelectorAll(`${place} > .fields > .field-row:not(.angles)`).length;
      if (fields !== undefined && drawn !== fields) wrong.push(`${name}: ${drawn} of ${fields} fields`);
    };
    for (const form of forms.settings)
      await open("setting", form, form.table === null ? form.fields.length : undefined);
    for (const form of forms.commands) await open("command", form, form.arguments.length);
    expect(wrong).toEqual([]);
  },
  300_000, // an Inertial Sense device has some hundred forms
);
