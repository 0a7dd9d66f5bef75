/** The styles of Configure; whatever part is loaded first brings all of them. */
import "../../forms/forms.css";
import "../../forms/tables.css";
import "./configure.css";
import "./compare.css";
import "./phone.css";
