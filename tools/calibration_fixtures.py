"""Writes one small calibration a dialect into crates/io/tests/data/dialects, as the other program writes it, and
expected.json: for each the pixels (first pixel centre (0.5, 0.5)) of one world point [mm], computed here by OpenCV and numpy.

    python tools/calibration_fixtures.py        needs numpy and opencv-python-headless
"""

import json
import struct
from pathlib import Path

import cv2
import numpy as np

OUT = Path(__file__).parent.parent / "crates/io/tests/data/dialects"
POINT_MM = np.array([40.0, -30.0, 55.0])
W, H = 640, 480
NAMES = ["cam00", "cam01", "cam02"]
expected = []


def rotation(i):
    """World to camera: three cameras around a head, looking at a place near the origin."""
    return cv2.Rodrigues(np.array([0.15 * (i - 1), 0.9 * i - 0.7, 0.05 * i]))[0]


R = [rotation(i) for i in range(3)]
T = [np.array([0.02 * i - 0.01, 0.015, 1.1 + 0.1 * i]) for i in range(3)]  # metres
K = [np.array([[900.0 + 10 * i, 0, 322.5 + i], [0, 905.0 + 10 * i, 238.25 - i], [0, 0, 1]]) for i in range(3)]
DIST5 = np.array([-0.21, 0.07, 1.2e-3, -8e-4, 0.01])
DIST8 = np.array([-0.21, 0.07, 1.2e-3, -8e-4, 0.01, 0.02, -0.01, 0.004])
DIST12 = np.r_[DIST8, 2e-3, -5e-4, -1e-3, 3e-4]
DIST14 = np.r_[DIST12, 0.02, -0.03]
FISH = np.array([-0.03, 0.012, -0.004, 0.0007])


def normalised(i):
    x = R[i] @ (POINT_MM / 1000) + T[i]
    return x[:2] / x[2]


def pinhole(i, dist=None, shift=0.0):
    p = cv2.projectPoints((POINT_MM / 1000).reshape(1, 3), cv2.Rodrigues(R[i])[0], T[i], K[i], dist)[0].ravel()
    return (p + shift).tolist()


def fisheye(i, k, shift=0.0):
    p = cv2.fisheye.projectPoints((POINT_MM / 1000).reshape(1, 1, 3), cv2.Rodrigues(R[i])[0], T[i], K[i], k)[0].ravel()
    return (p + shift).tolist()


def by_k(i, xy, shift=0.0):
    return (K[i][:2, :2] @ np.asarray(xy) + K[i][:2, 2] + shift).tolist()


def write(name, text):
    path = OUT / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())


def expect(path, pixels, unit_mm=None, sized=True, convention="", names=NAMES):
    """sized: the file has image sizes; otherwise the reader is told 640x480 for every view."""
    cameras = {name: pixel for name, pixel in zip(names, pixels)}
    expected.append({"path": path, "unit_mm": unit_mm, "sized": sized, "convention": convention, "cameras": cameras})


def c2w(i, gl):
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = R[i].T, -R[i].T @ T[i]
    return m @ np.diag([1, -1, -1, 1]) if gl else m


def nerfstudio():
    # Intrinsics for all, and what Nerfstudio did to COLMAP's world.
    applied = np.array([[1.0, 0, 0, 0.1], [0, 0, 1, -0.2], [0, -1, 0, 0.3]])
    def frame(i, scale=1.0, move=None, path="images/{}.png", **more):
        m = c2w(i, True)
        if move is not None:
            m = np.r_[move, [[0, 0, 0, 1]]] @ m
            m[:3, 3] *= scale
        return {"file_path": path.format(NAMES[i]), **more, "transform_matrix": m.tolist()}
    own = lambda i: {"fl_x": K[i][0, 0], "fl_y": K[i][1, 1], "cx": K[i][0, 2], "cy": K[i][1, 2], "w": W, "h": H}
    k = lambda d: dict(zip(["k1", "k2", "p1", "p2", "k3"], d.tolist()))
    one = {"camera_model": "OPENCV", **k(DIST5), "applied_transform": applied.tolist(), "applied_scale": 0.4,
           "frames": [frame(i, 0.4, applied, **own(i)) for i in range(3)]}
    write("nerfstudio/transforms.json", json.dumps(one, indent=2))
    expect("nerfstudio/transforms.json", [pinhole(i, DIST5) for i in range(3)], 1000)
    fish = {"camera_model": "OPENCV_FISHEYE", **dict(zip(["k1", "k2", "k3", "k4"], FISH.tolist())), **own(0),
            "frames": [frame(0, path="./{}/000000.jpg"), frame(1, path="./{}/000000.jpg", **own(1)),
                       frame(1, path="./{}/000001.jpg"), frame(2, path="./{}/000000.jpg", **own(2))]}
    write("nerfstudio_fisheye.json", json.dumps(fish))
    expect("nerfstudio_fisheye.json", [fisheye(i, FISH) for i in range(3)], 1000)
    angle = 2 * np.arctan(W / 2 / 900)
    write("nerf_synthetic.json", json.dumps({"camera_angle_x": angle, "frames": [frame(i) for i in range(3)]}))
    flat = [(900 * normalised(i) + [W / 2, H / 2]).tolist() for i in range(3)]
    expect("nerf_synthetic.json", flat, 1000, sized=False)


def easymocap():
    def storage(name, fill):
        fs = cv2.FileStorage(str(OUT / "easymocap" / name), cv2.FILE_STORAGE_WRITE)
        fs.startWriteStruct("names", cv2.FileNode_SEQ)
        for n in ["00", "01", "02"]:
            fs.write("", n)
        fs.endWriteStruct()
        for i, n in enumerate(["00", "01", "02"]):
            fill(fs, i, n)
        fs.release()
    (OUT / "easymocap").mkdir(parents=True, exist_ok=True)
    def intri(fs, i, n):
        fs.write(f"K_{n}", K[i])
        fs.write(f"dist_{n}", DIST5.reshape(1, 5))
    def extri(fs, i, n):
        fs.write(f"R_{n}", cv2.Rodrigues(R[i])[0])
        fs.write(f"Rot_{n}", R[i])
        fs.write(f"T_{n}", T[i].reshape(3, 1))
    storage("intri.yml", intri)
    storage("extri.yml", extri)
    expect("easymocap", [pinhole(i, DIST5, 0.5) for i in range(3)], sized=False, names=["00", "01", "02"])


def nersemble():
    w2c = lambda i: np.r_[np.c_[R[i], T[i]], [[0, 0, 0, 1]]].tolist()
    serial = ["222200036", "222200037", "222200038"]
    write("camera_params.json", json.dumps(
        {"world_2_cam": {s: w2c(i) for i, s in enumerate(serial)}, "intrinsics": K[0].tolist()}))
    pixels = [(K[0][:2, :2] @ normalised(i) + K[0][:2, 2] + 0.5).tolist() for i in range(3)]
    expect("camera_params.json", pixels, 1000, sized=False, names=serial)


def neus():
    arrays = {}
    scale = np.diag([0.3, 0.3, 0.3, 1.0])
    scale[:3, 3] = [0.01, 0.02, 0.03]
    for i in range(3):
        p = np.eye(4)
        p[:3] = K[i] @ np.c_[R[i], T[i]]
        arrays[f"world_mat_{i}"], arrays[f"scale_mat_{i}"] = p, scale
    OUT.mkdir(parents=True, exist_ok=True)
    np.savez(OUT / "cameras_sphere.npz", **arrays)
    expect("cameras_sphere.npz", [pinhole(i, None, 0.5) for i in range(3)], 1000, sized=False, names=["000", "001", "002"])


def krt():
    row = lambda m: " ".join(repr(float(x)) for x in np.asarray(m).ravel())
    par = "3\n" + "".join(f"{NAMES[i]}.png {row(K[i])} {row(R[i])} {row(T[i])}\n" for i in range(3))
    write("middlebury_par.txt", par)
    expect("middlebury_par.txt", [pinhole(i, None, 0.5) for i in range(3)], 1000, sized=False)
    mvs = lambda m: "\n".join(row(r) for r in m)
    for i in range(3):
        w2c = np.r_[np.c_[R[i], T[i]], [[0, 0, 0, 1]]]
        write(f"mvsnet/{NAMES[i]}_cam.txt", f"extrinsic\n{mvs(w2c)}\n\nintrinsic\n{mvs(K[i])}\n\n0.5 0.01\n")
        write(f"krtd/{NAMES[i]}.krtd", f"{mvs(K[i])}\n\n{mvs(R[i])}\n\n{row(T[i])}\n\n{row(DIST8)}\n")
        write(f"pmvs/{NAMES[i]}.txt", f"CONTOUR\n{mvs(K[i] @ np.c_[R[i], T[i]])}\n")
    expect("mvsnet", [pinhole(i, None, 0.5) for i in range(3)], 1000, sized=False)
    expect("krtd", [pinhole(i, DIST8, 0.5) for i in range(3)], 1000, sized=False)
    expect("pmvs", [pinhole(i, None, 0.5) for i in range(3)], 1000, sized=False)
    one = "# three cameras\n" + "".join(
        f"camera {NAMES[i]}\nsize = {W} {H}\nK = {row(K[i])}\ndist = {row(DIST5)}\nc2w =\n{mvs(c2w(i, True))}\n" for i in range(3))
    write("labelled_c2w.txt", one)
    expect("labelled_c2w.txt", [pinhole(i, DIST5) for i in range(3)], 1000, convention="pixel0.5")


def metashape():
    f, b1, b2 = 905.0, -5.0, 0.8
    k1, k2, k3, k4, p1, p2 = -0.21, 0.07, 0.01, -0.003, -8e-4, 1.2e-3
    cx, cy = 2.5, -1.75
    s, rot, move = 2.5, cv2.Rodrigues(np.array([0.3, -0.2, 0.5]))[0], np.array([0.4, -0.1, 0.2])
    cameras, pixels = "", []
    for i in range(3):
        world = c2w(i, False)
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = rot.T @ world[:3, :3], rot.T @ (world[:3, 3] - move) / s
        numbers = " ".join(f"{x:.17g}" for x in m.ravel())
        cameras += (f'      <camera id="{i}" sensor_id="0" component_id="0" label="{NAMES[i]}">\n'
                    f"        <transform>{numbers}</transform>\n        <orientation>1</orientation>\n      </camera>\n")
        x, y = normalised(i)
        r2 = x * x + y * y
        d = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        xx = x * d + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
        yy = y * d + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
        pixels.append([W / 2 + cx + xx * f + xx * b1 + yy * b2, H / 2 + cy + yy * f])
    similarity = (f'<rotation locked="false">{" ".join(f"{x:.17g}" for x in rot.ravel())}</rotation>\n'
                  f'          <translation locked="false">{" ".join(f"{x:.17g}" for x in move)}</translation>\n'
                  f'          <scale locked="false">{s}</scale>')
    terms = "".join(f"          <{n}>{v}</{n}>\n" for n, v in dict(
        f=f, cx=cx, cy=cy, b1=b1, b2=b2, k1=k1, k2=k2, k3=k3, k4=k4, p1=p1, p2=p2).items())
    write("metashape.xml", f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">
      <sensor id="0" label="unknown" type="frame">
        <resolution width="{W}" height="{H}"/>
        <property name="layer_index" value="0"/>
        <bands><band label="Red"/><band label="Green"/><band label="Blue"/></bands>
        <data_type>uint8</data_type>
        <calibration type="frame" class="adjusted">
          <resolution width="{W}" height="{H}"/>
{terms}        </calibration>
      </sensor>
    </sensors>
    <components next_id="1" active_id="0">
      <component id="0" label="Component 1">
        <transform>
          {similarity}
        </transform>
      </component>
    </components>
    <cameras next_id="4" next_group_id="0">
{cameras}      <camera id="3" sensor_id="0" label="not_aligned"/>
    </cameras>
    <reference>LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]</reference>
  </chunk>
</document>
""")
    expect("metashape.xml", pixels)


def opencv():
    for ending in ["yml", "xml", "json"]:
        for label, dist in [("k12", DIST12), ("k14", DIST14)]:
            path = OUT / f"opencv_{label}.{ending}"
            fs = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
            for i in range(3):
                fs.startWriteStruct(NAMES[i], cv2.FileNode_MAP)
                fs.write("image_width", W)
                fs.write("image_height", H)
                fs.write("camera_matrix", K[i])
                fs.write("distortion_coefficients", dist.reshape(1, -1))
                fs.write("R", R[i])
                fs.write("T", T[i].reshape(3, 1))
                fs.endWriteStruct()
            fs.release()
            expect(path.name, [pinhole(i, dist, 0.5) for i in range(3)], 1000)
    # As OpenCV's calibration sample writes a fisheye, one file a camera; one without the flag needs the word.
    for folder, flag in [("opencv_fisheye", True), ("opencv_unflagged", False)]:
        (OUT / folder).mkdir(parents=True, exist_ok=True)
        for i in range(3):
            fs = cv2.FileStorage(str(OUT / folder / f"{NAMES[i]}.yml"), cv2.FILE_STORAGE_WRITE)
            fs.write("image_width", W)
            fs.write("image_height", H)
            if flag:
                fs.write("fisheye_model", 1)
            fs.write("camera_matrix", K[i])
            fs.write("distortion_coefficients", FISH.reshape(4, 1))
            fs.write("rvec", cv2.Rodrigues(R[i])[0])
            fs.write("tvec", T[i].reshape(3, 1))
            fs.release()
        expect(folder, [fisheye(i, FISH, 0.5) for i in range(3)], 1000, convention="" if flag else "fisheye")


def quaternion(m):
    v = cv2.Rodrigues(m)[0].ravel()
    a = np.linalg.norm(v)
    return np.r_[np.cos(a / 2), np.sin(a / 2) * (v / a if a > 0 else v)]


def colmap():
    models = [
        ("SIMPLE_RADIAL", [900, 322.5, 238.25, -0.2]), ("RADIAL", [900, 322.5, 238.25, -0.2, 0.05]),
        ("FULL_OPENCV", [900, 905, 322.5, 238.25, *DIST8]), ("OPENCV_FISHEYE", [900, 905, 322.5, 238.25, *FISH]),
        ("SIMPLE_RADIAL_FISHEYE", [900, 322.5, 238.25, -0.03]), ("RADIAL_FISHEYE", [900, 322.5, 238.25, -0.03, 0.012]),
        ("THIN_PRISM_FISHEYE", [900, 905, 322.5, 238.25, -0.03, 0.012, 1e-3, -6e-4, -0.004, 7e-4, 8e-4, -5e-4]),
        ("FOV", [900, 905, 322.5, 238.25, 0.9]), ("SIMPLE_PINHOLE", [900, 322.5, 238.25]),
    ]
    pixels, names, cams, images = [], [], "# Camera list\n", "# Image list\n"
    for n, (model, p) in enumerate(models):
        i = n % 3
        simple = len(p) < 8 and model not in ("FOV",)
        fx, fy, cx, cy = (p[0], p[0], p[1], p[2]) if simple else p[:4]
        x, y = normalised(i)
        r = np.hypot(x, y)
        d = p[3:] if simple else p[4:]
        if "FISHEYE" in model:
            t = np.arctan(r) / r
            k = list(d) if "PRISM" not in model else [d[0], d[1], d[4], d[5]]
            k += [0] * (4 - len(k))
            u, v = x * t, y * t
            r2 = u * u + v * v
            s = sum(k[j] * r2 ** (j + 1) for j in range(4))
            du, dv = u * s, v * s
            if "PRISM" in model:
                p1, p2, s1, s2 = d[2], d[3], d[6], d[7]
                du += 2 * p1 * u * v + p2 * (r2 + 2 * u * u) + s1 * r2
                dv += 2 * p2 * u * v + p1 * (r2 + 2 * v * v) + s2 * r2
            x, y = u + du, v + dv
        elif model == "FOV":
            s = np.arctan(2 * r * np.tan(d[0] / 2)) / (r * d[0])
            x, y = x * s, y * s
        else:
            k = [d[0], d[1] if len(d) > 1 else 0, 0, 0] if len(d) in (1, 2) else list(d) or [0] * 4
            x, y = cv2.projectPoints(np.array([[x, y, 1.0]]), np.zeros(3), np.zeros(3), np.eye(3), np.array(k))[0].ravel()
        pixels.append([fx * x + cx, fy * y + cy])
        names.append(f"v{n}")
        cams += f"{n + 1} {model} {W} {H} {' '.join(repr(float(q)) for q in p)}\n"
        images += f"{n + 1} {' '.join(repr(float(q)) for q in [*quaternion(R[i]), *T[i]])} {n + 1} v{n}.png\n\n"
    write("colmap_models/cameras.txt", cams)
    write("colmap_models/images.txt", images)
    expect("colmap_models", pixels, 1000, names=names)

    # A rig: images hold only rounded poses, rigs and frames the exact ones.
    pose = lambda m, t: [*quaternion(m), *t]
    rel = [(R[i] @ R[0].T, T[i] - R[i] @ R[0].T @ T[0]) for i in range(3)]
    text = lambda v: " ".join(repr(float(x)) for x in v)
    cams = "".join(f"{i + 1} PINHOLE {W} {H} {text([K[i][0, 0], K[i][1, 1], K[i][0, 2], K[i][1, 2]])}\n" for i in range(3))
    rough = [np.round(pose(R[i], T[i]), 2) for i in range(3)]
    images = "".join(f"{i + 1} {text(rough[i])} {i + 1} {NAMES[i]}/000000.png\n\n" for i in range(3))
    sensors = "".join(f" CAMERA {i + 1} 1 {text(pose(*rel[i]))}" for i in (1, 2))
    frame = f"1 1 {text(pose(R[0], T[0]))} 3 CAMERA 1 1 CAMERA 2 2 CAMERA 3 3\n"
    for name, body in dict(cameras=cams, images=images, rigs=f"# Rigs\n1 3 CAMERA 1{sensors}\n", frames="# Frames\n" + frame).items():
        write(f"colmap_rig/{name}.txt", body)
    b = lambda fmt, *v: struct.pack("<" + fmt, *v)
    cams = b("Q", 3) + b"".join(b("IiQQ4d", i + 1, 1, W, H, K[i][0, 0], K[i][1, 1], K[i][0, 2], K[i][1, 2]) for i in range(3))
    images = b("Q", 3) + b"".join(
        b("I7dI", i + 1, *rough[i], i + 1) + f"{NAMES[i]}/000000.png".encode() + b"\0" + b("Q", 1) + b("ddq", 1.5, 2.5, -1)
        for i in range(3))
    rigs = b("QIIiI", 1, 1, 3, 0, 1) + b"".join(b("iIB7d", 0, i + 1, 1, *pose(*rel[i])) for i in (1, 2))
    frames = b("QII7dI", 1, 1, 1, *pose(R[0], T[0]), 3) + b"".join(b("iIQ", 0, i + 1, i + 1) for i in range(3))
    for name, body in dict(cameras=cams, images=images, rigs=rigs, frames=frames).items():
        write(f"colmap_rig_binary/{name}.bin", body)
    expect("colmap_rig", [pinhole(i) for i in range(3)], 1000)
    expect("colmap_rig_binary", [pinhole(i) for i in range(3)], 1000)


for dialect in [nerfstudio, easymocap, nersemble, neus, krt, metashape, opencv, colmap]:
    dialect()
write("expected.json", json.dumps({"point_mm": POINT_MM.tolist(), "files": expected}, indent=1))
