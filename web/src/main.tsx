/** Where the page starts: theme, store, shell. */
import "./ui/tokens.css";
