/** The part of a workspace with the plots that the user put together, as the words of a link (signals/custom-plots.ts). */
import { plotsOfWords, plotWord } from "../signals/custom-plots";
import { registerPart } from "./parts";
import { isKeys } from "../data/json";

registerPart<readonly string[]>({
  key: "customPlots",
  isNamedInLinks: true,
  read({ viewState: { customPlots } }) {
    const words = [...new Set(customPlots.peek().map(plotWord))];
    return words.length > 0 ? words : undefined;
  },
  check: (json) => (isKeys(json) && plotsOfWords(json).map(plotWord).join(" ") === json.join(" ") ? json : undefined),
  write: ({ viewState: { customPlots } }, words) => void (customPlots.value = plotsOfWords(words ?? [])),
});
