// Small helpers for elements.

export const element = (id) => document.getElementById(id);

export function write(id, text) {
  const found = element(id);
  if (found.textContent !== text) found.textContent = text;
}

export function made(name, attributes = {}, ...children) {
  const found = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) found[key] = value;
    else if (value !== false && value !== undefined && value !== null) found.setAttribute(key, value === true ? "" : value);
  }
  found.append(...children);
  return found;
}

export const fixed = (value, digits) => (typeof value === "number" ? value.toFixed(digits) : "–");

export function list(id, sentences, kind = "") {
  element(id).replaceChildren(...sentences.map((text) => made("li", { class: kind }, text)));
}

// Shows a fault in the banner until the next action.
export function tell(fault) {
  element("fault").hidden = !fault;
  write("fault", fault ? fault.message ?? String(fault) : "");
}

// Wraps a handler: what it throws is shown in the banner.
export const told = (act) => async (...given) => {
  try {
    tell(null);
    return await act(...given);
  } catch (fault) {
    tell(fault);
    return undefined;
  }
};

export function download(name, kind, text) {
  const link = made("a", { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
