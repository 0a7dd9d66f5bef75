/** Every part of a workspace: loading a file registers its parts. */
import "./view-parts";
import "./custom-plots";
import "./y-axes";
import "./plot-order";
