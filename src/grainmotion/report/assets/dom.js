"use strict";
// Elements and numbers as text.
(() => {
  const gm = (window.gm ??= {});
  const SVG = "http://www.w3.org/2000/svg";

  const fill = (element, attributes, children) => {
    for (const [name, value] of Object.entries(attributes ?? {})) {
      if (value === null || value === undefined || value === false) continue;
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
    return element;
  };

  /** `gm.el("button", { class: "x", onclick: f }, "text", child)`; texts are never taken as HTML. */
  gm.el = (tag, attributes, ...children) => fill(document.createElement(tag), attributes, children);
  gm.svg = (tag, attributes, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

  const name = (element) => element.dataset.focus ?? element.getAttribute("aria-label") ?? element.textContent;

  /**
   * `place.replaceChildren(...children)` for controls that draw themselves anew: the one that has the keyboard's focus
   * hands it to its successor of the same name (`data-focus`, else its label), or to `fallback` where there is none.
   */
  gm.refill = (place, children, fallback = null) => {
    const old = place.contains(document.activeElement) && document.activeElement !== place ? document.activeElement : null;
    place.replaceChildren(...children);
    if (!old) return;
    const next = [...place.querySelectorAll(old.tagName)].find((element) => name(element) === name(old) && !element.disabled);
    (next ?? fallback ?? place).focus({ preventScroll: true });
  };

  /** A number with fixed decimals and a true minus sign; – where there is none. */
  gm.fixed = (value, decimals) => {
    if (!Number.isFinite(value)) return "–";
    const text = value.toFixed(decimals);
    return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
  };

  /** A number with a few significant digits. */
  gm.significant = (value, digits = 3) => {
    if (!Number.isFinite(value)) return "–";
    if (value === 0) return "0";
    const size = Math.abs(Number(value.toPrecision(digits))); // 0.00999 becomes 0.010 with two digits, not 0.0100
    if (size >= 1e-4 && size < 1e6) {
      return gm.fixed(value, Math.max(0, digits - 1 - Math.floor(Math.log10(size))));
    }
    return value.toExponential(digits - 1).replaceAll("-", "−");
  };

  /** The value of one of the page's quantities as text, without its unit. */
  gm.quantityText = (quantity, value, lengthDecimals) => {
    if (quantity.digits === "length") return gm.fixed(value, lengthDecimals);
    if (quantity.digits === "angle") return gm.fixed(value, 3);
    if (quantity.digits === "strain") return gm.fixed(value, 4);
    if (quantity.key === "iterations") return gm.fixed(value, 0);
    return gm.significant(value, quantity.key.startsWith("sd_") ? 2 : 3);
  };
})();
