import numpy as np

from engine.raster import Canvas, heat

RED, BLACK = (255, 0, 0), (0, 0, 0)


def painted(canvas: Canvas) -> np.ndarray:
    return (canvas.pixels != 255).any(axis=2)


def test_two_triangles_fill_their_square_whichever_way_they_turn():
    canvas = Canvas(12, 10)
    at = np.array([[2.0, 3.0], [8.0, 3.0], [8.0, 7.0], [2.0, 7.0]])
    faces = np.array([[0, 1, 2], [0, 3, 2]])
    colours = np.array([RED, RED], dtype=np.uint8)
    canvas.triangles(at, faces, colours, BLACK, width=0.0)
    inside = np.zeros((10, 12), dtype=bool)
    inside[3:8, 2:9] = True
    np.testing.assert_array_equal(painted(canvas), inside)
    assert (canvas.pixels[inside] == RED).all()


def test_sides_are_darker_than_what_they_enclose():
    canvas = Canvas(40, 40)
    at = np.array([[2.0, 2.0], [38.0, 2.0], [2.0, 38.0]])
    canvas.triangles(at, np.array([[0, 1, 2]]), np.array([RED], np.uint8), BLACK, width=0.5)
    assert canvas.pixels[2, 20, 0] < 200
    assert tuple(canvas.pixels[10, 10]) == RED


def test_a_dot_covers_the_area_of_its_circle():
    canvas = Canvas(60, 60)
    canvas.dots(np.array([[30.2, 29.7]]), BLACK, width=20.0)
    covered = (255.0 - canvas.pixels[..., 0]).sum() / 255.0
    assert abs(covered - np.pi * 100.0) < 0.02 * np.pi * 100.0


def test_a_line_covers_its_length_times_its_width():
    canvas = Canvas(80, 60)
    canvas.lines(np.array([[[10.0, 10.0], [70.0, 50.0]]]), BLACK, width=3.0)
    covered = (255.0 - canvas.pixels[..., 0]).sum() / 255.0
    ends = np.pi * 1.5**2
    assert abs(covered - (np.hypot(60, 40) * 3.0 + ends)) < 0.03 * covered


def test_what_lies_outside_is_left_out():
    canvas = Canvas(8, 8)
    canvas.lines(np.array([[[-20.0, 4.0], [20.0, 4.0]]]), BLACK, width=1.0)
    canvas.dots(np.array([[50.0, 50.0]]), BLACK, width=9.0)
    assert painted(canvas)[4].all()
    assert painted(canvas).sum() == 8


def test_heat_goes_from_pale_to_dark():
    colours = heat(np.array([0.0, 0.5, 1.0, 7.0])).astype(int).sum(axis=1)
    assert (np.diff(colours) <= 0).all() and colours[0] > 700 and colours[2] == colours[3] < 180
