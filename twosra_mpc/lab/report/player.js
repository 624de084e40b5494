"use strict";

const byId = (id) => document.getElementById(id);

function player({ film, temperature_C }) {
  const last = film.time_s.length - 1;
  const slider = byId("slider");
  const robot = byId("robot");
  const [segments, hatches, links, units, wheels, numbers] = [
    ".segment", ".hatch", ".link", ".unit", ".wheel", ".number",
  ].map((name) => [...robot.querySelectorAll(name)]);
  const objects = [...document.querySelectorAll("#objects .object")];
  const names = [...document.querySelectorAll("#names text")];
  const trails = [...byId("trails").children];
  const levels = [...byId("thermometer").querySelectorAll(".level")];
  const cells = [...byId("segments").tBodies[0].rows].map((row) => [...row.cells].slice(1));
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let frame = 0;

  const fixed = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]+$)/, "");

  const clock = (seconds) => {
    const minutes = Math.floor(seconds / 60);
    return minutes ? `${minutes} min ${(seconds % 60).toFixed(2).padStart(5, "0")} s`
      : `${seconds.toFixed(seconds < 1 ? 3 : 2)} s`;
  };

  const showRobot = () => {
    const pose = film.poses[film.pose[frame]];
    const draw = (elements, points) =>
      elements.forEach((element, i) => element.setAttribute("points", points[i]));
    draw(segments, pose.segments);
    draw(hatches, pose.segments);
    draw(links, pose.links);
    draw(units, pose.units);
    draw(wheels, pose.wheels);
    numbers.forEach((number, i) => {
      const [x, y] = pose.centres[i].split(",");
      number.setAttribute("x", x);
      number.setAttribute("y", y);
    });
    if (objects.length) {
      objects.forEach((object, i) => object.setAttribute("transform", pose.objects[i]));
      names.forEach((name, i) => ["x", "y", "text-anchor"].forEach((key, k) =>
        name.setAttribute(key, pose.names[i][k])));
    }
    const past = film.poses.slice(0, film.pose[frame] + 1);
    draw(trails, [0, 1].map((i) => past.map((one) => one.centres[i]).join(" "))
      .concat(past.map((one) => one.origin).join(" ")));
  };

  const slower = byId("slower"); // another plan at the same times
  const shapeOf = (pose) => [
    ...[...pose.units, ...pose.wheels].map((points) => ["polygon", points]),
    ...[...pose.links, ...pose.segments].map((points) => ["polyline", points]),
  ];
  const showSlower = () => {
    const parts = shapeOf(film.ghost.poses[film.ghost.pose[frame]]);
    if (!slower.children.length) {
      slower.append(...parts.map(([kind]) => document.createElementNS(slower.namespaceURI, kind)));
    }
    parts.forEach(([, points], i) => slower.children[i].setAttribute("points", points));
  };

  const showSegments = () => {
    const [low, high] = temperature_C;
    film.state[frame].forEach((state, i) => {
      segments[i].dataset.state = levels[i].dataset.state = state;
      const warm = film.temperature_C[frame][i];
      const height = Math.max(0, Math.min(100, (100 * (warm - low)) / (high - low)));
      levels[i].setAttribute("y", 100 - height);
      levels[i].setAttribute("height", height);
      const current = film.current_A[frame][i];
      [state, fixed(warm, 1), `${(100 * film.melt_fraction[frame][i]).toFixed(0)} %`,
        current ? `${current.toFixed(2)} A` : "off",
      ].forEach((text, column) => { cells[i][column].textContent = text; });
    });
  };

  const show = (place) => {
    frame = Math.max(0, Math.min(last, Math.round(place)));
    const time = clock(film.time_s[frame]);
    byId("clock").textContent = time;
    byId("doing").textContent = film.doing[frame];
    showRobot();
    if (film.ghost) showSlower();
    showSegments();
    if (slider) {
      byId("cursor").style.left = `${(100 * frame) / last}%`;
      slider.value = frame;
      const states = film.state[frame].map((state, i) => `segment ${i + 1} ${state}`).join(", ");
      slider.setAttribute("aria-valuetext", `${time}, ${film.doing[frame]}, ${states}`);
      showPace();
    }
  };

  const showPace = () => {
    if (calm.matches) {
      byId("pace").textContent = "plays from event to event: your system asks for reduced motion";
      return;
    }
    const next = Math.min(last, Math.max(1, frame + 1));
    const each = (film.length_s / last) / Number(byId("speed").value);
    const pace = (film.time_s[next] - film.time_s[next - 1]) / each;
    byId("pace").textContent = pace >= 1.05 ? `${pace.toFixed(pace < 10 ? 1 : 0)} times as fast as the robot`
      : pace > 0.95 ? "as fast as the robot" : `slowed down to ${pace.toPrecision(1)} of the robot's speed`;
  };

  let before = null; // time of the last picture while playing [ms]; null while paused
  const control = () => {
    const play = byId("play");
    const speed = () => Number(byId("speed").value);
    let place = 0; // between frames while playing

    const go = (to) => { place = Math.max(0, Math.min(last, to)); show(place); };
    const pause = () => {
      before = null;
      play.textContent = frame === last ? "Replay" : "Play";
    };
    const nextEvent = () => film.events.find((event) => event > frame) ?? last;
    const previousEvent = () => film.events.findLast((event) => event < frame) ?? 0;
    const picture = (now) => {
      if (before === null) return;
      const passed = (speed() * (now - before)) / 1000;
      if (!calm.matches) {
        before = now;
        go(place + (passed * last) / film.length_s);
      } else if (passed >= 1) {
        before = now;
        go(nextEvent());
      }
      if (frame === last) pause();
      else requestAnimationFrame(picture);
    };
    const toggle = () => {
      if (before !== null) { pause(); return; }
      if (frame === last) go(0);
      before = performance.now();
      play.textContent = "Pause";
      requestAnimationFrame(picture);
    };
    const jump = (to) => { pause(); go(to); pause(); };

    play.addEventListener("click", toggle);
    byId("previous").addEventListener("click", () => jump(previousEvent()));
    byId("next").addEventListener("click", () => jump(nextEvent()));
    byId("speed").addEventListener("change", showPace);
    calm.addEventListener("change", showPace);
    slider.addEventListener("input", () => jump(Number(slider.value)));
    slider.addEventListener("keydown", (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      toggle();
    });
    const tracks = byId("tracks");
    const point = (event) => {
      const box = tracks.getBoundingClientRect();
      jump((last * (event.clientX - box.left)) / box.width);
    };
    tracks.addEventListener("pointerdown", (event) => {
      if (event.target === slider) return;
      tracks.setPointerCapture(event.pointerId);
      point(event);
    });
    tracks.addEventListener("pointermove", (event) => {
      if (tracks.hasPointerCapture(event.pointerId)) point(event);
    });
    document.querySelector(".controls").hidden = false;
  };

  if (slider) control();
  show(0);
  return () => { before = null; calm.removeEventListener("change", showPace); };
}
