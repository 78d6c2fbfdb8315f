// The operator's reset: asked for with a token, which is sent once and kept nowhere.

const element = (id) => document.getElementById(id);

export function makeReset() {
  const dialog = element("dialog");
  const token = element("token");
  const refusal = element("refusal");
  let asking = false;

  element("ask").addEventListener("click", () => {
    token.value = "";
    refusal.textContent = "";
    element("answer").textContent = "";
    dialog.showModal();
    token.focus();
  });
  element("cancel").addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => (token.value = ""));
  element("form").addEventListener("submit", async (event) => {
    event.preventDefault();
    if (asking) return;
    asking = element("send").disabled = true;
    refusal.textContent = "Asking the monitor …";
    const sent = token.value;
    token.value = "";
    const { granted, message } = await ask(sent);
    asking = element("send").disabled = false;
    const time = new Date().toLocaleTimeString("en-GB");
    element("answer").textContent = granted ? `Reset granted at ${time}.` : `Reset refused at ${time}: ${message}`;
    if (granted) {
      dialog.close();
      return;
    }
    refusal.textContent = `Refused: ${message}`;
    token.focus();
  });

  // A reset is only for a withdrawal that the monitor is there to end; a lost connection must not hide behind a dialog.
  return (possible, connected) => {
    element("ask").disabled = !possible;
    if (!connected) dialog.close();
  };
}

async function ask(token) {
  try {
    const headers = { "Content-Type": "application/json" };
    const answer = await fetch("/reset", { method: "POST", headers, body: JSON.stringify({ token }) });
    return answer.ok ? await answer.json() : { granted: false, message: `the console's server answered ${answer.status}` };
  } catch {
    return { granted: false, message: "the console's server does not answer" };
  }
}
