import { expect, it } from "vitest";
import { placeBeside } from "./tour";

const CARD = { width: 320, height: 160 };
const PAGE = { width: 1440, height: 900 };

it("stands beside a part that leaves room, else below, above, or within it, and never beyond the page", () => {
  const rail = { left: 0, top: 48, width: 232, height: 852 };
  expect(placeBeside(rail, CARD, PAGE)).toEqual({ left: 244, top: 48 });
  const side = { left: 1148, top: 48, width: 292, height: 852 };
  expect(placeBeside(side, CARD, PAGE)).toEqual({ left: 816, top: 48 });
  const phone = { width: 390, height: 844 };
  expect(placeBeside({ left: 0, top: 700, width: 390, height: 60 }, CARD, phone)).toEqual({ left: 35, top: 528 });
  expect(placeBeside({ left: 0, top: 40, width: 390, height: 60 }, CARD, phone)).toEqual({ left: 35, top: 112 });
  expect(placeBeside({ left: 0, top: 60, width: 390, height: 720 }, CARD, phone)).toEqual({ left: 35, top: 340 });
});
