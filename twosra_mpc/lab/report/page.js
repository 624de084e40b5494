
function copyButtons() {
  for (const button of document.querySelectorAll("[data-copy]")) {
    button.hidden = false;
    button.addEventListener("click", () => {
      getSelection().selectAllChildren(byId(button.dataset.copy));
      const done = document.execCommand("copy"); // also works in a page opened from a file
      button.textContent = done ? "Copied" : "Selected";
    });
  }
}

function saveButton() {
  const button = byId("save");
  button.hidden = false;
  button.addEventListener("click", () => {
    const text = byId("plan-data").textContent;
    const address = URL.createObjectURL(new Blob([text, "\n"], { type: "application/json" }));
    const link = Object.assign(document.createElement("a"), { href: address, download: button.dataset.name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  });
}

const motion = byId("motion-data");
if (motion) player(JSON.parse(motion.textContent));
copyButtons();
saveButton();
