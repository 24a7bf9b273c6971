"""Tests the demo as a user runs it: test_postpass.py PROGRAM FOLDER headless|measure|window."""

import contextlib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
import unittest

import numpy
import OpenImageIO as oiio

PROGRAM, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])


def run(*arguments, fails=False):
    """Returns what the program prints; where it is to fail, on both streams."""
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=500)
    if fails:
        assert done.returncode != 0, done.stdout
        return done.stdout + done.stderr
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def pixels(path):
    image = oiio.ImageBuf(str(path))
    assert not image.has_error, image.geterror()
    return image.get_pixels(oiio.FLOAT)[..., :3]


def numbers(text, pattern):
    found = re.search(pattern, text)
    assert found, f"no {pattern} in {text}"
    return [float(group) for group in found.groups()]


ALLOCATIONS = r"(\d+) frames: (\d+) of the host, (\d+) for Vulkan objects"


class Headless(unittest.TestCase):
    def test_three_hundred_frames_are_valid(self):
        for in_flight in (2, 3):
            printed = run("--headless", "--size", "16x16", "--frames", 300, "--history", "--in-flight", in_flight,
                          "--validate")  # fmt: skip
            self.assertIn("validation messages: 0", printed)

    def test_three_hundred_frames_allocate_nothing(self):
        for in_flight in (2, 3):  # no --validate, as the validation layer allocates
            printed = run("--headless", "--size", "16x16", "--frames", 308, "--history", "--in-flight", in_flight,
                          "--check-allocations")  # fmt: skip
            frames, host, vulkan = numbers(printed, "allocations in " + ALLOCATIONS)
            self.assertGreaterEqual(frames, 300)
            self.assertEqual((host, vulkan), (0, 0))
            # Allocations are counted: the first frames, for which the driver compiles, have some.
            self.assertGreater(numbers(printed, "allocations in the first " + ALLOCATIONS)[1], 0)
            for part in ("LRHS", "HRLS", "fusion", "show", "frame"):
                mean, *percentiles = numbers(printed, rf"{part} +" + r" *([\d.]+)" * 5)
                self.assertGreater(mean, 0)
                self.assertEqual(percentiles, sorted(percentiles))

    def test_all_keys_resize_minimise_and_device_change(self):
        png = FOLDER / "keys.png"
        script = {
            3: "key=1", 6: "key=2", 9: "key=4", 13: "key=3", 14: "key=h", 17: "key=space", 20: "key=s", 24: "key=q",
            28: "key=s", 32: "key=m", 34: "key=o", 36: "key=d", 40: "key=f", 44: "resize=50x37", 48: "minimise",
            52: "restore",
        }  # fmt: skip
        text = ",".join(f"{frame}:{event}" for frame, event in script.items())
        printed = run("--headless", "--size", "48x40", "--frames", 60, "--script", text, "--png", png, "--validate")
        for line in (
            "frame 0: renders x4-fast, 48x40", "frame 3: shows LRHS", "frame 6: shows HRLS", "frame 9: shows converged",
            "frame 13: shows fused", "frame 14: history on", "frame 17: camera still",
            "frame 20: renders x2-fast, 48x40", "frame 24: renders x2-balanced", "frame 28: renders x4-balanced",
            "frame 32: renders x4-fast", "frame 34: objects move", "frame 36: device", "frame 40: frames in flight 3",
            "frame 44: renders x4-fast, 50x37", "frame 48: window minimised", "frame 52: window restored",
            "validation messages: 0",
        ):  # fmt: skip
            self.assertIn(line, printed)
        self.assertEqual(pixels(png).shape, (37, 50, 3))

    def test_what_is_made_anew_at_the_end_takes_no_frame_away(self):
        png, y4m = FOLDER / "end.png", FOLDER / "end.y4m"
        run("--headless", "--size", "24x16", "--script", "3:key=f,3:quit", "--png", png, "--y4m", y4m)
        self.assertEqual(pixels(png).shape, (16, 24, 3))
        self.assertEqual(y4m.read_bytes().count(b"FRAME\n"), 3)

    def test_overlay_is_text_over_the_image(self):
        shown, plain = FOLDER / "shown.png", FOLDER / "plain.png"
        common = ("--headless", "--size", "128x96", "--still", "--frames", 2, "--png")
        run(*common, shown)
        run(*common, plain, "--no-overlay")
        text, image = pixels(shown), pixels(plain)
        differs = numpy.abs(text - image).max(-1) > 0.02
        self.assertGreater(differs[:60].mean(), 0.5)
        self.assertLess(differs[70:].mean(), 0.01)
        self.assertGreater((text[:60] == 1).all(-1).mean(), 0.05)

    def test_y4m_holds_all_frames(self):
        y4m = FOLDER / "frames.y4m"
        run("--headless", "--size", "24x16", "--frames", 5, "--y4m", y4m)
        content = y4m.read_bytes()
        header, _, rest = content.partition(b"\n")
        self.assertEqual(header, b"YUV4MPEG2 W24 H16 F30000:1000 Ip A1:1 C444")
        self.assertEqual(len(rest), 5 * (6 + 3 * 24 * 16))
        frames = [rest[i * 1158 + 6 : (i + 1) * 1158] for i in range(5)]
        self.assertNotEqual(frames[0], frames[4])

    def test_the_camera_and_its_noise_are_the_same_in_every_run(self):
        first, second = FOLDER / "first.png", FOLDER / "second.png"
        for png in (first, second):
            run("--headless", "--size", "32x24", "--frames", 6, "--moving", "--history", "--no-overlay", "--png", png)
        self.assertTrue((pixels(first) == pixels(second)).all())

    def test_bad_input_is_refused(self):
        png = FOLDER / "none.png"
        for arguments, message in (
            (("--size", "0x8"), "WIDTHxHEIGHT"),
            (("--model", "x3-fast"), "x4-fast"),
            (("--models", FOLDER / "nowhere"), "nowhere"),
            (("--script", "5:key"), "key=K"),
            (("--script", "key=h"), "FRAME:EVENT"),
            (("--in-flight", "7"), "in-flight"),
            (("--measure", "--measure-samples", "0"), "multiples of 16"),
            (("--size", "16x16", "--script", "0:minimise", "--frames", "2"), "no frame"),
            (("--size", "16x16", "--script", "2:resize=8x8", "--frames", "6", "--y4m", FOLDER / "two.y4m"), "one size"),
        ):
            self.assertIn(message, run("--headless", "--png", png, *arguments, fails=True))
        self.assertFalse(png.exists())
        self.assertEqual(list(FOLDER.glob("two.y4m*")), [])


class Measure(unittest.TestCase):
    def test_fused_is_good_and_the_history_steadies_it(self):
        printed = run("--measure", "--size", "96x96", "--measure-frames", 8, "--measure-samples", 64,
                      "--reference-samples", 128, "--validate")  # fmt: skip
        fused, blended, converged = numbers(
            printed, r"flicker: fused ([\d.]+), with history ([\d.]+), converged \(64 samples\) ([\d.]+)"
        )
        self.assertLess(blended, fused / 2)
        self.assertLess(fused, converged + 2)  # the bound that docs/postpass.md states
        lrhs, hrls, still, still_blended = numbers(
            printed, r"bicubic ([\d.]+), HRLS ([\d.]+), fused ([\d.]+), with history ([\d.]+)"
        )
        self.assertGreater(still, lrhs + 3)
        self.assertGreater(still, hrls + 6)
        self.assertGreater(still_blended, still)
        for what in ("camera", "scene"):
            each = re.findall(rf"moving {what}, frame \d+, PSNR: fused ([\d.]+), with history ([\d.]+)", printed)
            self.assertEqual(len(each), 2)
            for fused, joined in each:
                self.assertGreater(float(joined), float(fused) + 0.5)


class Display:
    """Runs an X server of its own, whose screen is a file."""

    def __enter__(self):
        shutil.rmtree(FOLDER / "screen", ignore_errors=True)
        (FOLDER / "screen").mkdir(parents=True)
        read, write = os.pipe()
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "640x480x24", "-fbdir", str(FOLDER / "screen")]
        self.server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        assert number, "Xvfb does not start"
        self.environment = {**os.environ, "DISPLAY": ":" + number}
        return self

    def __exit__(self, *_):
        self.server.terminate()
        self.server.wait()

    def xdotool(self, *arguments):
        return subprocess.run(["xdotool", *map(str, arguments)], env=self.environment, check=True, capture_output=True,
                              text=True).stdout  # fmt: skip

    def screen(self):
        """Returns [480, 640, 3] from an XWD file.

        The file holds big-endian words, a map of colours and pixels of four bytes, B G R first.
        """
        content = (FOLDER / "screen" / "Xvfb_screen0").read_bytes()
        header = numpy.frombuffer(content, ">u4", 25)
        start = int(header[0]) + 12 * int(header[19])
        rows = numpy.frombuffer(content, numpy.uint8, 480 * int(header[12]), start).reshape(480, -1)
        return rows[:, : 4 * 640].reshape(480, 640, 4)[..., 2::-1] / 255.0


class Window(unittest.TestCase):
    def wait_for(self, line, seconds=120):
        end = time.monotonic() + seconds
        while line not in self.log.read_text():
            self.assertLess(time.monotonic(), end, f"no {line} in {self.log.read_text()}")
            self.assertIsNone(self.program.poll(), self.log.read_text())
            time.sleep(0.1)

    @contextlib.contextmanager
    def started(self, display, *arguments):
        self.log = FOLDER / "window.txt"
        with open(self.log, "w") as log:
            self.program = subprocess.Popen([PROGRAM, "--validate", *arguments], env=display.environment, stdout=log,
                                            stderr=log)  # fmt: skip
            try:
                yield
            finally:
                self.program.kill()
                self.program.wait()

    def test_keys_resizing_and_closing(self):
        with Display() as display, self.started(display, "--size", "128x96", "--zoom", "2", "--still"):
            self.wait_for("renders x4-fast, 128x96")
            window = display.xdotool("search", "--sync", "--name", "raymeld postpass").split()[0]
            display.xdotool("mousemove", "--window", window, 20, 200)
            for key, line in (("h", "history on"), ("4", "shows converged"), ("3", "shows fused"), ("f", "in flight 3"),
                              ("space", "camera moves"), ("d", "device"), ("q", "renders x4-balanced"),
                              ("q", "renders x4-fast"), ("s", "renders x2-fast"),
                              ("m", "renders x4-balanced"),
                              ("m", "renders x4-fast")):  # fmt: skip
                before = self.log.read_text()
                display.xdotool("key", key)
                end = time.monotonic() + 120
                while line not in self.log.read_text()[len(before) :]:
                    self.assertLess(time.monotonic(), end, f"{key}: no {line} in {self.log.read_text()}")
                    time.sleep(0.1)
            display.xdotool("windowsize", window, 320, 256)
            self.wait_for("renders x4-fast, 160x128")
            place = dict(part.split("=") for part in display.xdotool("getwindowgeometry", "--shell", window).split())
            left, top = int(place["X"]), int(place["Y"])
            end = time.monotonic() + 60
            while True:  # waits until the window has been drawn at its new size
                shot = display.screen()[top : top + 256, left : left + 320]
                if shot.shape == (256, 320, 3) and shot[-32:, -32:].std() > 0.01:
                    break
                self.assertLess(time.monotonic(), end)
                time.sleep(0.2)
            image = oiio.ImageBuf(oiio.ImageSpec(320, 256, 3, oiio.UINT8))
            image.set_pixels(image.roi, shot.astype(numpy.float32))
            image.write(str(FOLDER / "window.png"))
            self.assertTrue((shot[0::2, 0::2] == shot[1::2, 1::2]).all(), "not zoomed by two")
            self.assertGreater((shot[:128] == 1).all(-1).mean(), 0.02, "no text")
            display.xdotool("key", "Escape")
            self.assertEqual(self.program.wait(60), 0, self.log.read_text())
            self.assertIn("validation messages: 0", self.log.read_text())

    def test_minimised_it_waits(self):
        with Display() as display, self.started(
            display, "--size", "64x48", "--frames", "24", "--script", "4:minimise,12:restore,16:resize=100x80"
        ):
            self.assertEqual(self.program.wait(120), 0, self.log.read_text())
            printed = self.log.read_text()
            self.assertIn("frame 12: window restored", printed)
            self.assertIn("renders x4-fast, 50x40", printed)
            first, settled = (int(n) for n in re.findall(r"(\d+) frames: ", printed))
            self.assertEqual(first + settled, 16)

    def test_without_a_display_it_says_what_to_do(self):
        environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        done = subprocess.run([PROGRAM], env=environment, capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("--headless", done.stderr)


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    os.environ["XDG_CACHE_HOME"] = str(FOLDER / "cache")
    unittest.main(argv=[sys.argv[0], *(name.capitalize() for name in sys.argv[3:])], verbosity=2)
