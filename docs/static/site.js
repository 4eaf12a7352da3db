// What can be scrolled sideways can also be scrolled with the keyboard, and nothing else gets the focus.
const mark = () => document.querySelectorAll("pre, .table-wrapper, .railroad-scroll").forEach((one) => {
  if (one.scrollWidth > one.clientWidth) one.tabIndex = 0;
  else one.removeAttribute("tabindex");
});
addEventListener("load", mark);
addEventListener("resize", mark);
