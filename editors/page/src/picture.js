// Shows a model: a picture whose objects can be marked, or the same as text.

import { make, showSvg } from "../../../envgraph/page/player.js";

/** @typedef {import("./types.js").Picture} PictureData */

const OUTSET = 2; // pixels between a shape and its frame
const SVG = "http://www.w3.org/2000/svg";

/** @type {Promise<{renderSVGElement: (dot: string) => SVGSVGElement}> | undefined} */
let graphviz;

/** Return a placer of graphs; it is loaded when the first graph is shown, because it is large. */
const loadGraphviz = () => (graphviz ??= import("@viz-js/viz").then((module) => module.instance()));

export class ModelPicture {
  constructor() {
    this.frame = make("div", { class: "picture", tabindex: "0", role: "group", "aria-label": "Picture of the model" });
    this.text = make("pre", { tabindex: "0", "aria-label": "The model as text" });
    this.details = make("details", {}, make("summary", {}, "As text"), this.text);
    this.enlarge = make("button", { type: "button", "aria-pressed": "false", hidden: true, onclick: () => this.resize() }, "Enlarge");
    this.element = make("div", { class: "picture-pane" }, this.frame, this.details);
    /** @type {number[]} */ this.marked = [];
    this.drawing = 0;
  }

  /** @param {PictureData} picture @param {string} label */
  async show(picture, label) {
    const drawing = ++this.drawing;
    this.text.textContent = picture.text ?? "";
    let svg = picture.svg;
    if (picture.kind !== "grid" && picture.dot) {
      try {
        const drawn = (await loadGraphviz()).renderSVGElement(picture.dot);
        // The node `n12` is the object 12.
        for (const node of drawn.querySelectorAll("g.node")) {
          node.setAttribute("data-object", node.querySelector("title")?.textContent?.slice(1) ?? "");
        }
        svg = drawn.outerHTML;
      } catch (error) {
        console.warn("Graphviz did not draw the model; its own drawing is shown.", error);
      }
      if (drawing !== this.drawing) return; // another picture was shown meanwhile
    }
    showSvg(this.frame, svg, label);
    if (!svg) this.frame.replaceChildren(make("pre", {}, picture.text ?? "The model is empty."));
    this.enlarge.hidden = picture.kind !== "boxes" || !svg;
    this.mark(this.marked);
  }

  /** Show a graph in the size in which its texts are readable, or so that all of it is visible. */
  resize() {
    const isLarge = this.frame.classList.toggle("enlarged");
    this.enlarge.setAttribute("aria-pressed", String(isLarge));
    this.mark(this.marked);
  }

  /** Draw frames around objects. @param {number[]} objects their ids */
  mark(objects) {
    this.marked = objects;
    const svg = this.frame.querySelector("svg");
    svg?.querySelector(":scope > .marks")?.remove();
    if (!svg || !objects.length) return;
    const marks = document.createElementNS(SVG, "g");
    marks.classList.add("marks");
    const toPicture = /** @type {DOMMatrix} */ (svg.getScreenCTM()).inverse();
    for (const id of objects) {
      const shape = svg.querySelector(`[data-object="${id}"]`); // the first one is the largest, such as a cell below a token
      if (shape) marks.append(...frames(shape, toPicture));
    }
    svg.append(marks);
    marks.firstElementChild?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
}

/** Return a frame around a shape: a light line below a dark one, which is visible on every colour.
 * @param {any} shape @param {DOMMatrix} toPicture */
function frames(shape, toPicture) {
  const box = shape.getBBox();
  const gap = OUTSET / shape.getScreenCTM().a;
  const [x, y, width, height] = [box.x - gap, box.y - gap, box.width + 2 * gap, box.height + 2 * gap];
  const { a, b, c, d, e, f } = toPicture.multiply(shape.getScreenCTM());
  return ["below", "above"].map((name) => {
    const frame = document.createElementNS(SVG, "rect");
    const values = { x, y, width, height, class: `mark ${name}`, transform: `matrix(${[a, b, c, d, e, f].join(" ")})` };
    for (const [key, value] of Object.entries(values)) frame.setAttribute(key, String(value));
    return frame;
  });
}
