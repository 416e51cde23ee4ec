"""Posed RGB-D: the four layouts, separate cameras, gravity, bad frames, and a real kitchen."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skimage.io import imsave

from pcdbench.cloud import PointCloud
from pcdbench.datasets.rgbd import Rgbd
from pcdbench.datasets.rgbd.fusion import Settings, fused
from pcdbench.datasets.rgbd.gravity import levelled, up_direction
from pcdbench.datasets.rgbd.layouts import layout_of, read_sequence
from pcdbench.datasets.rgbd.sequence import Camera
from pcdbench.errors import CacheWarning, CloudError, PcdbenchError
from pcdbench.formats import CloudWarning
from pcdbench.geometry.neighbors import nearest
from pcdbench.geometry.poses import inverse, transform
from pcdbench.geometry.visibility import MeshRaycaster

W, H = 160, 120
DEPTH = Camera(140.0, 140.0, 79.5, 59.5, W, H)
COLOR = Camera(150.0, 150.0, 82.0, 58.0, W, H)
T_COLOR_DEPTH = np.eye(4)
T_COLOR_DEPTH[0, 3] = -0.10
# The world of the poses is not upright: turned about all axes and moved.
T_WORLD_ROOM = np.eye(4)
T_WORLD_ROOM[:3, :3] = Rotation.from_euler("zyx", [20, 12, -110], degrees=True).as_matrix()
T_WORLD_ROOM[:3, 3] = [0.5, -2.0, 1.5]


def box(low, high):
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def room_mesh():
    parts = [box([0, 0, 0], [4, 3, 2.5]), box([1.5, 1, 0.6], [2.5, 2, 0.75]), box([3.2, 0.0, 0], [4, 1, 1.8])]
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    triangles = [faces + offset for (_, faces), offset in zip(parts, offsets, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(triangles)


def color_at(points):
    """Stripes 40 cm wide in x, a gradient in z: what is seen where can be told from the colour."""
    red = np.where(np.floor((points[:, 0] + 0.17) / 0.4) % 2 == 0, 40, 220)
    return np.stack([red, 80 + 40 * points[:, 1], 30 + 70 * points[:, 2]], axis=1)


class Camcorder:
    """Renders the room; `frames` poses of the depth camera in the room, looking around from its middle."""

    def __init__(self, frames=10):
        self.raycaster = MeshRaycaster(*room_mesh())
        self.T_room_depth = []
        for number in range(frames):
            yaw = 2 * np.pi * number / frames
            z = np.array([np.cos(yaw), np.sin(yaw), -0.35])
            z /= np.linalg.norm(z)
            x = np.cross(z, [0, 0, 1.0])
            x /= np.linalg.norm(x)
            T = np.eye(4)
            T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
            T[:3, 3] = [1.2 + 0.2 * np.sin(yaw), 1.5 + 0.2 * np.cos(yaw), 1.5 + 0.1 * np.sin(2 * yaw)]
            self.T_room_depth.append(T)

    def image(self, camera, T_room_camera):
        v, u = np.mgrid[:H, :W]
        rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones((H, W))], axis=-1)
        lengths = np.linalg.norm(rays, axis=-1)
        directions = (rays / lengths[..., None]).reshape(-1, 3) @ T_room_camera[:3, :3].T
        hits = self.raycaster.cast(T_room_camera[:3, 3], directions)
        points = T_room_camera[:3, 3] + hits.range_m[:, None] * directions
        return (hits.range_m / lengths.ravel()).reshape(H, W), color_at(points).reshape(H, W, 3)

    def frames(self, scale=1000.0, color_camera=DEPTH, T_color_depth=None):
        """Depth image, colour image and `T_world_depth` of each frame."""
        for T in self.T_room_depth:
            depth, _ = self.image(DEPTH, T)
            T_color = T if T_color_depth is None else T @ inverse(T_color_depth)
            _, color = self.image(color_camera, T_color)
            yield np.rint(depth * scale).astype(np.uint16), color.astype(np.uint8), T_WORLD_ROOM @ T


def write_image(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    imsave(path, image, check_contrast=False)


def seven_scenes(folder, frames):
    for number, (depth, color, T) in enumerate(frames):
        write_image(folder / f"frame-{number:06d}.depth.png", depth)
        write_image(folder / f"frame-{number:06d}.color.png", color)
        np.savetxt(folder / f"frame-{number:06d}.pose.txt", T, "%.8f")
    np.savetxt(folder / "camera-intrinsics.txt", DEPTH.matrix)
    (folder / "calibration.json").write_text(json.dumps({"depth": CAMERA}))


CAMERA = {"fx": 140.0, "fy": 140.0, "cx": 79.5, "cy": 59.5, "width": W, "height": H}


def tum(folder, frames):
    lists = {"rgb": [], "depth": [], "groundtruth": ["# timestamp tx ty tz qx qy qz qw"]}
    for number, (depth, color, T) in enumerate(frames):
        seconds = 1305031102.0 + number / 30
        write_image(folder / f"depth/{seconds:.6f}.png", depth)
        write_image(folder / f"rgb/{seconds + 0.004:.6f}.png", color)
        lists["depth"].append(f"{seconds:.6f} depth/{seconds:.6f}.png")
        lists["rgb"].append(f"{seconds + 0.004:.6f} rgb/{seconds + 0.004:.6f}.png")
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]
        lists["groundtruth"].append(f"{seconds - 0.006:.4f} " + " ".join(f"{value:.8f}" for value in values))
        # Motion capture is faster than the camera: poses of other times lie in between.
        lists["groundtruth"].append(f"{seconds + 0.012:.4f} 9 9 9 0 0 0 1")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    (folder / "calibration.json").write_text(json.dumps({"depth": CAMERA | {"scale": 5000}}))


def scannet(folder, frames):
    for number, (depth, color, T) in enumerate(frames):
        write_image(folder / f"depth/{number}.png", depth)
        write_image(folder / f"color/{number}.jpg", color)
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / f"pose/{number}.txt", T, "%.8f")
    (folder / "intrinsic").mkdir()
    for name, matrix in (("intrinsic_depth", DEPTH.matrix), ("intrinsic_color", COLOR.matrix)):
        padded = np.eye(4)
        padded[:3, :3] = matrix
        np.savetxt(folder / f"intrinsic/{name}.txt", padded)
    np.savetxt(folder / "intrinsic/extrinsic_color.txt", inverse(T_COLOR_DEPTH))
    np.savetxt(folder / "intrinsic/extrinsic_depth.txt", np.eye(4))


# RTAB-Map's base looks along x; its camera's optical frame is turned.
T_BASE_OPTICAL = np.eye(4)
T_BASE_OPTICAL[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
T_BASE_OPTICAL[:3, 3] = [0.1, 0.0, 0.3]


def rtabmap(folder, frames, named_by="time"):
    rows = ["#timestamp x y z qx qy qz qw id"]
    for number, (depth, color, T) in enumerate(frames):
        seconds = 1641234567.25 + number / 2
        name = f"{seconds:.6f}" if named_by == "time" else f"{number + 7}"
        write_image(folder / f"scan_depth/{name}.png", depth)
        write_image(folder / f"scan_rgb/{name}.jpg", color)
        data = ", ".join(f"{value:g}" for value in DEPTH.matrix.ravel())
        local = ", ".join(f"{value:g}" for value in T_BASE_OPTICAL[:3].ravel())
        (folder / "scan_calib").mkdir(exist_ok=True)
        (folder / f"scan_calib/{name}.yaml").write_text(
            f'%YAML:1.0\n---\ncamera_name: "{name}"\nimage_width: {W}\nimage_height: {H}\n'
            f"camera_matrix:\n   rows: 3\n   cols: 3\n   data: [ {data} ]\n"
            f"local_transform:\n   rows: 3\n   cols: 4\n   data: [ {local} ]\n"
        )
        base = T @ inverse(T_BASE_OPTICAL)
        values = [*base[:3, 3], *Rotation.from_matrix(base[:3, :3]).as_quat()]
        rows.append(f"{seconds:.6f} " + " ".join(f"{value:.8f}" for value in values) + f" {number + 7}")
    (folder / "scan_poses.txt").write_text("\n".join(rows) + "\n")


def opened(folder, **options):
    return Rgbd(folder, Rgbd.Options(**{"complete_points": 500, "voxel_m": 0.025, "min_weight": 0.0, **options}))


def surface(spacing=0.02):
    """Points on all surfaces of the room, in the room's frame."""
    from pcdbench.geometry.freespace import points_on_triangles

    vertices, triangles = room_mesh()
    return points_on_triangles(vertices[triangles], spacing)


@pytest.fixture(scope="module")
def camcorder():
    return Camcorder()


LAYOUTS = {
    "7-Scenes": (seven_scenes, {}),
    "TUM RGB-D": (tum, {"scale": 5000.0}),
    "ScanNet": (scannet, {"color_camera": COLOR, "T_color_depth": T_COLOR_DEPTH}),
    "RTAB-Map": (rtabmap, {}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_layout_gives_the_room_upright_and_coloured(tmp_path, camcorder, layout):
    write, how = LAYOUTS[layout]
    folder = tmp_path / "my scan"
    folder.mkdir()
    write(folder, camcorder.frames(**how))
    assert layout_of(folder) == layout
    dataset = opened(tmp_path)
    assert dataset.scene_names("all") == ("my_scan",)
    scene = dataset.scene("my_scan")
    assert scene.info["frames"] == "10" and len(scene.complete) == 500
    # Upright with its floor at 0; turned about z by what its world is turned: the room is compared in its own frame.
    T_zup_room = _T_zup_room(scene)
    assert np.degrees(np.arccos(T_zup_room[2, 2])) < 1.0
    assert abs(T_zup_room[2, 3]) < 0.02
    points = transform(inverse(T_zup_room), scene.dense.points)
    distances, _ = nearest(points, surface())
    assert np.median(distances) < 0.012 and np.percentile(distances, 95) < 0.04
    off = np.abs(scene.dense.colors * 255 - color_at(points))
    assert np.median(off) < 8 and (off[:, 0] < 60).mean() > 0.85
    at = [T[:3, 3] for T in camcorder.T_room_depth]
    np.testing.assert_allclose(transform(inverse(T_zup_room), scene.viewpoints), at, atol=1e-4)


def _T_zup_room(scene):
    """The transform of the room into the scene: from where the cameras are in both (Kabsch)."""
    room = np.array([T[:3, 3] for T in Camcorder().T_room_depth])
    left, _, right = np.linalg.svd((scene.viewpoints - scene.viewpoints.mean(axis=0)).T @ (room - room.mean(axis=0)))
    T = np.eye(4)
    T[:3, :3] = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    T[:3, 3] = scene.viewpoints.mean(axis=0) - T[:3, :3] @ room.mean(axis=0)
    return T


def test_separate_cameras_give_colours_their_place(tmp_path, camcorder):
    """The same images with and without calibration: only with it are stripes where they belong."""
    wrong = {}
    for calibrated in (True, False):
        folder = tmp_path / str(calibrated)
        frames = list(camcorder.frames(color_camera=COLOR, T_color_depth=T_COLOR_DEPTH))
        folder.mkdir()
        seven_scenes(folder, frames)
        color = {"fx": 150.0, "fy": 150.0, "cx": 82.0, "cy": 58.0, "T_color_depth": T_COLOR_DEPTH.tolist()}
        content = {"depth": CAMERA} | ({"color": color} if calibrated else {})
        (folder / "calibration.json").write_text(json.dumps(content))
        scene = opened(folder).scene(str(calibrated))
        points = transform(inverse(_T_zup_room(scene)), scene.dense.points)
        wrong[calibrated] = (np.abs(scene.dense.colors[:, 0] * 255 - color_at(points)[:, 0]) > 60).mean()
    assert wrong[True] < 0.12 and wrong[False] > 2 * wrong[True]


def test_calibration_may_say_what_is_up(tmp_path, camcorder):
    seven_scenes(tmp_path, camcorder.frames())
    T_zup_world = inverse(T_WORLD_ROOM)
    T_zup_world[2, 3] += 0.3
    (tmp_path / "calibration.json").write_text(json.dumps({"depth": CAMERA, "T_zup_world": T_zup_world.tolist()}))
    scene = opened(tmp_path).scene(tmp_path.name)
    np.testing.assert_allclose(_T_zup_room(scene)[:3, :3], np.eye(3), atol=1e-4)
    assert abs(_T_zup_room(scene)[2, 3] - 0.3) < 1e-3


def test_up_may_be_an_axis(tmp_path, camcorder):
    frames = [(depth, color, inverse(T_WORLD_ROOM) @ T) for depth, color, T in camcorder.frames()]
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    seven_scenes(tmp_path, [(depth, color, turned @ T) for depth, color, T in frames])
    scene = opened(tmp_path, up="-z").scene(tmp_path.name)
    np.testing.assert_allclose(_T_zup_room(scene)[2, :3], [0, 0, 1], atol=1e-6)
    assert abs(_T_zup_room(scene)[2, 3]) < 0.02


def test_bad_frames_are_skipped_and_counted(tmp_path):
    frames = list(Camcorder(14).frames())
    bad = [
        (2, lambda depth, color, T: (depth * 0, color, T)),
        (3, lambda depth, color, T: (depth, color, np.full((4, 4), -np.inf))),
        (4, lambda depth, color, T: (depth, color, np.full((4, 4), np.nan))),
        (5, lambda depth, color, T: (depth, color, T * np.array([[1.3], [1], [1], [1]]))),
        (6, lambda depth, color, T: (frames[1][0], color, T)),
        (11, lambda depth, color, T: (depth * 0 + 4100, color, T)),
        (12, lambda depth, color, T: (np.where(np.arange(W) == 1, depth, 0), color, T)),
    ]
    for number, spoilt in bad:
        frames[number] = spoilt(*frames[number])
    seven_scenes(tmp_path, frames)
    (tmp_path / "frame-000007.pose.txt").write_text("1 0 0\n")
    (tmp_path / "frame-000008.depth.png").write_bytes(b"not an image")
    (tmp_path / "frame-000009.color.png").unlink()
    (tmp_path / "frame-000010.depth.png").unlink()
    dataset = opened(tmp_path)
    findings = dataset.check(tmp_path.name)
    assert all(its.usable for its in findings)
    told = {its.problem for its in findings}
    assert told == {
        "1 of 14 frames have a depth of zero everywhere: skipped",
        "3 of 14 frames have no pose (tracking was lost): skipped",
        "1 of 14 frames have a pose that is not rigid: skipped",
        "1 of 14 frames have the same depth image as an earlier frame: skipped",
        "1 of 14 frames have no readable depth image: skipped",
        "1 of 14 frames have no readable colour image: skipped",
        "1 of 14 frames have no depth image: skipped",
        "2 of 14 frames have too little depth within 4 m: skipped",
    }
    with pytest.warns(CloudWarning) as warned:
        assert dataset.scene(tmp_path.name).info["frames"] == "3"
    assert {str(its.message) for its in warned} == told


def test_a_sequence_of_far_frames_alone_is_refused(tmp_path, camcorder):
    seven_scenes(tmp_path, camcorder.frames())
    dataset = opened(tmp_path, depth_max_m=0.1)
    (found,) = dataset.check(tmp_path.name)
    assert not found.usable
    assert found.problem == f"{tmp_path}: none of its frames can be used (10 with too little depth within 0.1 m)"


def test_poses_in_map_coordinates_give_the_same_room(tmp_path, camcorder):
    scenes, frames = [], list(camcorder.frames())
    for offset in (0, np.array([4e5, 5e6, 100])):
        folder = tmp_path / str(offset) / "room"
        folder.mkdir(parents=True)
        for *_, T in frames:
            T[:3, 3] += offset
        seven_scenes(folder, frames)
        scenes.append(opened(folder, partial_frames=5).scene("room_frames0-4"))
    clouds = [
        [PointCloud(transform(inverse(_T_zup_room(its)), cloud.points)) for cloud in (its.dense, its.partial)]
        for its in scenes
    ]
    for near_cloud, far_cloud in zip(*clouds, strict=True):
        assert abs(len(far_cloud) - len(near_cloud)) < 0.01 * len(near_cloud)
        distances, _ = nearest(far_cloud.points, near_cloud.points)
        assert np.median(distances) < 1e-3 and np.percentile(distances, 95) < 1e-2


def test_without_colour_images_there_is_no_colour(tmp_path, camcorder):
    seven_scenes(tmp_path, camcorder.frames())
    for path in tmp_path.glob("*.color.png"):
        path.unlink()
    dataset = opened(tmp_path)
    assert dataset.scene(tmp_path.name).dense.colors is None
    assert [its.problem for its in dataset.check(tmp_path.name)] == ["it has no colour"]


@pytest.mark.parametrize("colored", [True, False])
def test_points_need_as_many_frames_as_asked(tmp_path, colored):
    for number in range(3):
        write_image(tmp_path / f"frame-{number:06d}.depth.png", np.full((H, W), 2007 + number, np.uint16))
        if colored:
            write_image(tmp_path / f"frame-{number:06d}.color.png", np.full((H, W, 3), 99, np.uint8))
        np.savetxt(tmp_path / f"frame-{number:06d}.pose.txt", np.eye(4))
    np.savetxt(tmp_path / "frame-000003.pose.txt", np.full((4, 4), np.nan))
    write_image(tmp_path / "frame-000003.depth.png", np.full((H, W), 1900, np.uint16))
    sequence = read_sequence(tmp_path)
    for frames in (0, 1, 3):
        assert len(fused(sequence, Settings(0.025, 4.0, 4.0, frames)).cloud) > 1000
    with pytest.raises(CloudError, match=r"no point was seen in 4 of its 3 usable frames .*left out: 1 with no pose"):
        fused(sequence, Settings(0.025, 4.0, 4.0, 4))


def test_pictures_of_depth_are_refused(tmp_path, camcorder):
    seven_scenes(
        tmp_path, ((np.clip(depth / 16, 0, 255).astype(np.uint8), *rest) for depth, *rest in camcorder.frames())
    )
    with pytest.raises(CloudError, match="is a picture of depth, not depth"):
        opened(tmp_path).scene(tmp_path.name)


def test_a_wrong_depth_scale_is_asked_about(tmp_path, camcorder):
    seven_scenes(tmp_path, camcorder.frames(scale=10_000.0))
    with pytest.warns(CloudWarning, match=r"median depth is .* m, odd for a room; is the depth scale 100 a metre"):
        (tmp_path / "calibration.json").write_text(json.dumps({"depth": CAMERA | {"scale": 100}}))
        opened(tmp_path, depth_max_m=1000.0, voxel_m=2.0).scene(tmp_path.name)


def test_poses_in_millimetres_are_asked_about(tmp_path, camcorder):
    frames = [
        (depth, color, T * np.array([[1, 1, 1, 1000]] * 3 + [[1, 1, 1, 1]])) for depth, color, T in camcorder.frames()
    ]
    seven_scenes(tmp_path, frames)
    with pytest.warns(CloudWarning, match="are the poses in millimetres"):
        opened(tmp_path).scene(tmp_path.name)


def test_rtabmap_images_may_be_named_by_id_and_poses_be_the_cameras(tmp_path, camcorder):
    frames = list(camcorder.frames())
    rtabmap(tmp_path, frames, named_by="id")
    sequence = read_sequence(tmp_path)
    np.testing.assert_allclose([its.T_world_depth for its in sequence.frames], [T for *_, T in frames], atol=1e-6)
    rows = [" ".join(f"{value:.9f}" for value in T[:3].ravel()) for *_, T in frames]
    (tmp_path / "scan_poses.txt").unlink()
    (tmp_path / "scan_camera_poses.txt").write_text("\n".join(rows))
    sequence = read_sequence(tmp_path)
    np.testing.assert_allclose([its.T_world_depth for its in sequence.frames], [T for *_, T in frames], atol=1e-6)
    (tmp_path / "scan_camera_poses.txt").write_text("\n".join(rows[:-1]))
    with pytest.raises(CloudError, match="has 9 poses without times for 10 images"):
        read_sequence(tmp_path)


def test_tum_images_without_a_pose_of_their_time_are_counted(tmp_path, camcorder):
    tum(tmp_path, camcorder.frames(scale=5000.0))
    poses = (tmp_path / "groundtruth.txt").read_text().splitlines()
    (tmp_path / "groundtruth.txt").write_text("\n".join(poses[:1] + poses[5:]) + "\n")
    sequence = read_sequence(tmp_path)
    assert (len(sequence.frames), sequence.unusable) == (8, {"no pose of its time": 2})


def still(folder, at=""):
    """A TUM sequence without a calibration: one plain image three times."""
    for name, seconds in (("depth", range(3)), ("rgb", range(3))):
        for number in seconds:
            image = np.full((H, W), 10_000 + number, np.uint16) if name == "depth" else np.zeros((H, W, 3), np.uint8)
            write_image(folder / name / f"{number}.png", image)
        (folder / f"{name}.txt").write_text("".join(f"{number} {at}{name}/{number}.png\n" for number in seconds))
    (folder / "groundtruth.txt").write_text("".join(f"{number} 0 0 0 0 0 0 1\n" for number in range(3)))


def test_a_cameras_name_and_calibration_are_found_from_inside_and_through_links(tmp_path, monkeypatch):
    folder = tmp_path / "scans/freiburg2_desk"
    still(folder)
    (tmp_path / "scans/calibration.json").write_text(json.dumps({"color": CAMERA}))
    link = tmp_path / "links/desk"
    link.parent.mkdir()
    link.symlink_to(folder, target_is_directory=True)
    monkeypatch.chdir(folder)
    sequences = [opened(path)._sequence("freiburg2_desk") for path in (folder, Path("."), link)]
    sequences.append(opened(link.parent)._sequence("desk"))
    for sequence in sequences:
        assert sequence.depth_camera.fx == 520.9 and sequence.color_camera == DEPTH


def test_a_relative_folder_may_name_its_images_absolutely(tmp_path, monkeypatch):
    still(tmp_path / "a", f"{tmp_path}/a/")
    monkeypatch.chdir(tmp_path)
    assert opened(Path("a")).digest("a") == opened(tmp_path / "a").digest("a")


def test_a_camera_that_a_name_tells_decides_the_scene(tmp_path):
    still(tmp_path / "a/room")
    before, digest = opened(tmp_path / "a").scene("room"), opened(tmp_path / "a").digest("room")
    (tmp_path / "a/room").rename(tmp_path / "a/freiburg3_room")
    # The scene's own name stays, and with it all else that its digest is of.
    (tmp_path / "b").mkdir()
    (tmp_path / "b/room").symlink_to(tmp_path / "a/freiburg3_room", target_is_directory=True)
    after = opened(tmp_path / "b").scene("room")
    assert np.ptp(after.dense.points[:, 0]) != np.ptp(before.dense.points[:, 0])
    assert opened(tmp_path / "b").digest("room") != digest
    # With a calibration the name tells nothing.
    (tmp_path / "a/freiburg3_room/calibration.json").write_text(json.dumps({"depth": CAMERA}))
    calibrated = opened(tmp_path / "b").digest("room")
    (tmp_path / "b/room").unlink()
    (tmp_path / "a/freiburg3_room").rename(tmp_path / "b/room")
    assert opened(tmp_path / "b").digest("room") == calibrated


def test_poses_without_times_need_images_named_by_number(tmp_path):
    for name in ("10", "9", "nan"):
        write_image(tmp_path / f"depth/{name}.png", np.zeros((2, 2), np.uint16))
        (tmp_path / "calib").mkdir(exist_ok=True)
        text = "image_width: 0\nimage_height: 0\ncamera_matrix:\n  data: [ 2, 0, 1, 0, 2, 1, 0, 0, 1 ]\n"
        (tmp_path / f"calib/{name}.yaml").write_text(text)
    (tmp_path / "poses.txt").write_text("".join(f"1 0 0 {number} 0 1 0 0 0 0 1 0\n" for number in range(3)))
    with pytest.raises(CloudError, match=r"poses\.txt has poses without times, and not all images are named by number"):
        read_sequence(tmp_path)
    (tmp_path / "depth/nan.png").rename(tmp_path / "depth/11.png")
    (tmp_path / "calib/nan.yaml").rename(tmp_path / "calib/11.yaml")
    frames = read_sequence(tmp_path).frames
    assert [(its.name, its.T_world_depth[0, 3]) for its in frames] == [("9", 0), ("10", 1), ("11", 2)]
    assert frames[0].camera.scaled_to(4, 4) == Camera(2, 2, 1, 1), "a size of 0 is of no image"


def test_files_that_no_number_tells_apart_are_sorted_by_name(tmp_path):
    for folder in ("depth", "pose", "intrinsic"):
        (tmp_path / folder).mkdir()
    (tmp_path / "intrinsic/intrinsic_depth.txt").write_text("2 0 1 0 2 1 0 0 1")
    for name in ("b", "10", "a", "nan", "9"):
        (tmp_path / f"pose/{name}.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")
        (tmp_path / f"depth/{name}.png").touch()
    assert [its.name for its in read_sequence(tmp_path).frames] == ["9", "10", "a", "b", "nan"]


def test_runs_of_frames_are_pairs_with_the_whole(tmp_path, camcorder):
    seven_scenes(tmp_path, camcorder.frames())
    dataset = opened(tmp_path, partial_frames=4)
    assert dataset.scene_names("all") == [f"{tmp_path.name}_frames0-3", f"{tmp_path.name}_frames4-7"]
    assert {dataset.environment(name) for name in dataset.scene_names("all")} == {tmp_path.name}
    first, second = (dataset.scene(name) for name in dataset.scene_names("all"))
    np.testing.assert_array_equal(first.dense.points, second.dense.points)
    assert 0 < len(first.partial) < len(first.dense)
    distances, _ = nearest(first.partial.points, first.dense.points)
    assert np.median(distances) < 0.01
    missed = [nearest(first.dense.points, its.partial.points)[0] > 0.1 for its in (first, second)]
    assert all(0.2 < mask.mean() < 0.9 for mask in missed) and (missed[0] != missed[1]).mean() > 0.2
    with pytest.raises(PcdbenchError, match="has 11 frames"):
        opened(tmp_path, partial_frames=11).scene_names("all")


def test_frames_are_fused_once(tmp_path, camcorder, monkeypatch):
    seven_scenes(tmp_path, camcorder.frames())
    first = opened(tmp_path).scene(tmp_path.name)
    monkeypatch.setattr("pcdbench.datasets.rgbd.fused", lambda *_: pytest.fail("fused again"))
    again = opened(tmp_path).scene(tmp_path.name)
    np.testing.assert_array_equal(first.dense.points, again.dense.points)
    np.testing.assert_array_equal(first.complete.colors, again.complete.colors)


def test_without_a_cache_a_scene_is_the_same(tmp_path, camcorder, monkeypatch):
    seven_scenes(tmp_path, camcorder.frames())
    kept = opened(tmp_path).scene(tmp_path.name)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PCDBENCH_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(CacheWarning, match="what is made is not kept"):
        scene = opened(tmp_path).scene(tmp_path.name)
    np.testing.assert_array_equal(scene.dense.points, kept.dense.points)
    np.testing.assert_array_equal(scene.dense.colors, kept.dense.colors)
    np.testing.assert_array_equal(scene.viewpoints, kept.viewpoints)


def test_sequences_in_linked_folders_are_found(tmp_path):
    for name in ("scans/one", "elsewhere/two", "elsewhere/two/inside"):
        (tmp_path / name).mkdir(parents=True)
        np.savetxt(tmp_path / name / "frame-000000.pose.txt", np.eye(4))
    (tmp_path / "scans/all").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    (tmp_path / "elsewhere/round").symlink_to(tmp_path / "scans", target_is_directory=True)
    assert opened(tmp_path / "scans").scene_names("all") == ("all-two", "one")


def test_sequences_whose_names_clash_are_told_apart(tmp_path):
    for name in ("room 1", "room_1", "floor/room", "floor-room", "küche"):
        folder = tmp_path / name
        folder.mkdir(parents=True)
        np.savetxt(folder / "frame-000000.pose.txt", np.eye(4))
        (folder / "frame-000000.depth.png").write_bytes(name.encode())
    dataset = opened(tmp_path)
    names = dataset.scene_names("all")
    assert sorted(names) == ["floor-room", "floor-room-2", "küche", "room_1", "room_1-2"]
    assert len({dataset._sequence(name).root for name in names}) == 5


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[", "is no calibration"),
        ('{"depth": {"fx": 1}}', "is no calibration"),
        ('{"T_zup_world": [1, 2]}', "is no calibration"),
        (json.dumps({"depth": CAMERA | {"width": 0}}), "is no calibration .*width is 0, not a number above 0"),
        (json.dumps({"depth": CAMERA | {"fx": float("nan")}}), "is no calibration .*fx is nan, not a number above 0"),
        (json.dumps({"depth": CAMERA | {"scale": 0}}), "is no calibration .*scale is 0, not a number above 0"),
        ('{"T_zup_world": [2,0,0,0, 0,2,0,0, 0,0,2,0, 0,0,0,1]}', "no rigid transform"),
    ],
)
def test_malformed_calibrations_are_named(tmp_path, content, message):
    np.savetxt(tmp_path / "frame-000000.pose.txt", np.eye(4))
    (tmp_path / "calibration.json").write_text(content)
    with pytest.raises(CloudError, match=rf"calibration\.json.*{message}"):
        read_sequence(tmp_path)


def test_folders_without_frames_are_named(tmp_path):
    with pytest.raises(PcdbenchError, match="holds no sequence in the layout of 7-Scenes"):
        opened(tmp_path).scene_names("all")
    np.savetxt(tmp_path / "frame-000000.pose.txt", np.eye(4))
    with pytest.raises(CloudError, match=r"none of its frames can be used \(1 with no depth image\)"):
        opened(tmp_path).scene(tmp_path.name)


@pytest.mark.parametrize("seed", range(6))
def test_gravity_is_found_in_turned_rooms(seed):
    """Normals of a room with sloping clutter; the cameras' own up is off by up to 40 degrees."""
    rng = np.random.default_rng(seed)
    level = np.tile([0, 0, 1.0], (400, 1))
    heading = rng.uniform(0, np.pi)
    walls = [[np.cos(heading + turn), np.sin(heading + turn), 0] for turn in (0, np.pi / 2)]
    clutter = rng.normal(size=(300, 3))
    normals = np.concatenate([level, np.repeat(walls, 500, axis=0), clutter]) + rng.normal(0, 0.03, (1700, 3))
    normals *= rng.choice([-1, 1], 1700)[:, None] / np.linalg.norm(normals, axis=1, keepdims=True)
    R = Rotation.random(random_state=seed).as_matrix()
    tilt = Rotation.from_euler("xy", rng.uniform(-28, 28, 2), degrees=True).as_matrix()
    up = up_direction(normals @ R.T, R @ tilt @ [0, 0, 1.0])
    assert np.degrees(np.arccos(np.clip(up @ R[:, 2], -1, 1))) < 1.0


@pytest.mark.parametrize("up", [[0, 0, 1], [0, 0, -1], [0.6, 0, 0.8], [0, -1, 0]])
def test_levelled_is_a_rotation_that_takes_up_to_z(up):
    R = levelled(np.array(up, float))
    np.testing.assert_allclose(R @ up, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0


REAL = Path(os.environ.get("PCDBENCH_REAL_DATA", Path(__file__).parents[3] / "shared/data/real"))


@pytest.mark.skipif(not (REAL / "redkitchen/rgbd").is_dir(), reason="no real scans; PCDBENCH_REAL_DATA names the place")
def test_the_kitchen_agrees_with_its_reference_fusion():
    """7-Scenes redkitchen, every fifth of its hundred frames, against the cloud that others fused from 200."""
    full = PointCloud.read(REAL / "redkitchen/clouds/full.ply").points
    scene = opened(REAL / "redkitchen/rgbd", every=5, voxel_m=0.0125, min_weight=2.0).scene("rgbd")
    distances, _ = nearest(scene.dense.points, full)
    assert np.median(distances[distances < 0.1]) < 0.01 and (distances < 0.1).mean() > 0.95
    distances, _ = nearest(full, scene.dense.points)
    assert np.median(distances[distances < 0.1]) < 0.01 and (distances < 0.1).mean() > 0.85
    found = opened(REAL / "redkitchen/rgbd", every=5, voxel_m=0.0125, min_weight=2.0)
    sequence = found._sequence("rgbd")
    fused = found._fused("rgbd", None)
    up = up_direction(fused.normals, -fused.T_world_depth[:, :3, 1].mean(axis=0))
    assert np.degrees(np.arccos(up @ sequence.T_zup_world[2, :3])) < 1.5
