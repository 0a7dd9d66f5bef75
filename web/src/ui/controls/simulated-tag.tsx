/** Says of a device, or of what is recorded of one, that a simulator made its data. */
import { COMMON } from "../../texts/common";

export function SimulatedTag({ of }: { readonly of: { readonly simulated: boolean } | undefined }) {
  if (!of?.simulated) return null;
  return (
    <span class="tag simulated" title={COMMON.simulatedHint}>
      {COMMON.simulated}
    </span>
  );
}
