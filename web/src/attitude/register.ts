/** The attitude panel, in the middle of the page. */
import { mountAttitude } from "./panel";
import { COMMON } from "../texts/common";
import { registerPanel } from "../panels/registry";

registerPanel({
  id: "attitude",
  title: COMMON.attitude,
  where: "main",
  order: 0,
  class: "attitude",
  isWide: true,
  mount: mountAttitude,
});
