//! Whatever is wrong with a scene, the error names the file, the line and what to do.

use bdpm::load::{Loaded, load};
use std::path::PathBuf;
use tempfile::TempDir;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const SCENE: &str = r#"[camera]
position = [0, 0, 5]
target = [0, 0, 0]
fov_y_deg = 40

[[mesh]]
file = "a.obj"

[[light]]
type = "point"
position = [0, 0, 5]
intensity = 10
"#;

/// A folder of files; the last one is loaded.
struct Files(TempDir, PathBuf);

fn files(list: &[(&str, &[u8])]) -> Files {
    let folder = TempDir::new().unwrap();
    let mut last = PathBuf::new();
    for (name, content) in list {
        last = folder.path().join(name);
        std::fs::write(&last, content).unwrap();
    }
    Files(folder, last)
}

impl Files {
    fn load(&self) -> Loaded {
        load(&self.1).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The error must hold all parts, and always an advice.
    #[track_caller]
    fn refused(&self, parts: &[&str]) {
        let error = load(&self.1).expect_err("loaded").to_string();
        for part in parts.iter().chain(&["\nhelp: "]) {
            assert!(error.contains(part), "no {part:?} in:\n{error}");
        }
        assert!(error.contains(&*self.0.path().to_string_lossy()), "no path in:\n{error}");
    }
}

fn obj(content: &str) -> Files {
    files(&[("a.obj", content.as_bytes())])
}

fn mtl(content: &str) -> Files {
    let obj = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}");
    files(&[("a.mtl", content.as_bytes()), ("a.obj", obj.as_bytes())])
}

fn toml(content: &str) -> Files {
    files(&[("a.obj", TRIANGLE.as_bytes()), ("s.toml", content.as_bytes())])
}

/// The good scene with a text replaced.
fn changed(from: &str, to: &str) -> Files {
    assert!(SCENE.contains(from), "{from}");
    toml(&SCENE.replacen(from, to, 1))
}

#[test]
fn base_scene_of_the_other_tests_loads() {
    assert_eq!(toml(SCENE).load().scene.triangle_count(), 1);
    assert_eq!(obj(TRIANGLE).load().scene.triangle_count(), 1);
}

#[test]
fn missing_files_are_refused() {
    let folder = TempDir::new().unwrap();
    for name in ["no.toml", "no.obj", "no"] {
        let error = load(folder.path().join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("help: check the path"), "{error}");
    }
    changed("a.obj", "b.obj")
        .refused(&["s.toml:7: cannot read the mesh file `b.obj`", "relative to"]);
}

#[test]
fn folders_and_unknown_types_are_refused() {
    let empty = TempDir::new().unwrap();
    let error = load(empty.path()).unwrap_err().to_string();
    assert!(error.contains("holds no scene.toml"), "{error}");
    std::fs::create_dir(empty.path().join("d.obj")).unwrap();
    std::fs::write(empty.path().join("scene.toml"), SCENE.replace("a.obj", "d.obj")).unwrap();
    let error = load(empty.path()).unwrap_err().to_string();
    assert!(error.contains("d.obj: this is a folder"), "{error}");
    files(&[("a.stl", b"{}")]).refused(&["a.stl: scenes of type `.stl`", "scene.toml"]);
    files(&[("a.BLEND", b"BLENDER-v400")]).refused(&[
        "a.BLEND: files of Blender",
        "Export > glTF 2.0",
        "docs/how-to/blender.md",
    ]);
    changed("a.obj", "a.stl")
        .refused(&["s.toml:7: `a.stl` is neither an OBJ nor a PLY file", ".obj"]);
}

#[cfg(unix)]
#[test]
fn endless_devices_are_not_read() {
    let folder = TempDir::new().unwrap();
    for name in ["zero.obj", "zero.toml", "zero.gltf", "zero.glb"] {
        let link = folder.path().join(name);
        std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
        let error = load(&link).unwrap_err().to_string();
        assert!(error.contains("neither a regular file nor a folder"), "{error}");
    }
}

#[test]
fn malformed_obj_records_are_refused() {
    let vertex = "such as `v 0.5 1 -2`";
    obj("v 1 2 x\n").refused(&["a.obj:1: `x` is not a number", "1 | v 1 2 x", vertex]);
    obj("\nv 1 2\n").refused(&["a.obj:2: the vertex has 2 coordinates", vertex]);
    obj("v 1 2 3 0\n").refused(&["a.obj:1: the vertex has a coordinate that is not finite"]);
    let face = "such as `f 1 2 3`";
    obj("v 0 0 0\nf 1 a 1\n").refused(&["a.obj:2: `a` is not a face's vertex", face]);
    obj("v 0 0 0\nf 1/1/1/1 1 1\n").refused(&["a.obj:2: `1/1/1/1` is not", face]);
    obj("f\n").refused(&["a.obj:1: the face has no vertices", face]);
    obj("vt\n").refused(&["a.obj:1: `vt` needs 1 or more numbers", "such as `vt 0.5`"]);
    obj("vn 0 1\n").refused(&["a.obj:1: `vn` needs 3 or more", "such as `vn 0.5 0.5 0.5`"]);
}

#[test]
fn coordinates_that_are_not_finite_or_too_large_are_refused() {
    for (word, problem) in [
        ("nan", "not finite"),
        ("-inf", "not finite"),
        ("1e39", "not finite"),
        ("2e12", "beyond 1e12"),
    ] {
        let content = format!("v 0 0 0\nv 1 {word} 0\n");
        obj(&content).refused(&["a.obj:2: the vertex has a coordinate", problem, "help: "]);
    }
    changed("[0, 0, 5]", "[0, nan, 5]").refused(&["s.toml:2: a number is not finite"]);
    changed("[0, 0, 5]", "[0, 2e12, 5]").refused(&["s.toml:2: a coordinate is beyond 1e12"]);
}

#[test]
fn indices_out_of_range_are_refused() {
    for index in ["4", "0", "-4", "9223372036854775807", "-9223372036854775808"] {
        let content = TRIANGLE.replace("f 1 2 3", &format!("f 1 2 {index}"));
        let problem = format!("a.obj:4: the face refers to vertex {index}, but 3 are defined");
        obj(&content).refused(&[&problem, "number vertices from 1"]);
    }
    // Vertices come before their faces.
    obj("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").refused(&["a.obj:1: the face refers to vertex 1"]);
}

#[test]
fn scenes_without_triangles_of_any_area_are_refused() {
    for content in ["", "# nothing\n", "v 0 0 0\n", "v 0 0 0\nf 1 1\n"] {
        obj(content).refused(&["a.obj: the scene has no triangle", "add a mesh"]);
    }
    toml(&SCENE.replace("[[mesh]]\nfile = \"a.obj\"\n", ""))
        .refused(&["s.toml: the scene has no triangle"]);
    let flat = "v 0 0 0\nv 1 0 0\nv 2 0 0\n";
    obj(&format!("{flat}f 1 2 3\nf 1 1 2\n")).refused(&["all 2 triangles", "no area"]);
    let loaded = obj(&format!("{flat}v 0 1 0\nf 1 2 3\nf 1 2 4\nf 1 1 4\n")).load();
    assert_eq!(loaded.scene.triangle_count(), 1);
    assert!(loaded.warnings.iter().any(|n| n.text == "dropped 2 triangles without area"));
}

#[test]
fn malformed_mtl_records_are_refused() {
    mtl("newmtl m\nKd 1 0\n").refused(&["a.mtl:2: `Kd` needs three numbers", "`Kd 0.5 0.5 0.5`"]);
    mtl("newmtl m\nKe 1 x 0\n").refused(&["a.mtl:2: `Ke` needs three numbers", "2 | Ke 1 x 0"]);
    mtl("newmtl m\nKe 1 -1 0\n").refused(&["a.mtl:2: `Ke` is negative", "at least 0"]);
    mtl("newmtl m\nKd nan 0 0\n").refused(&["a.mtl:2: `Kd` is negative or not finite"]);
    mtl("Kd 1 1 1\n").refused(&["a.mtl:1: `Kd` comes before any material", "newmtl"]);
    mtl("newmtl\n").refused(&["a.mtl:1: the material has no name"]);
}

#[test]
fn missing_libraries_and_materials_are_warnings() {
    let loaded = obj(&format!("mtllib no.mtl\nusemtl m\n{TRIANGLE}")).load();
    let warnings = loaded.warnings_text();
    assert!(
        warnings.contains("a.obj:1: the material library `no.mtl` does not exist"),
        "{warnings}"
    );
    assert!(warnings.contains("`m` undefined; used gray of albedo 0.5"), "{warnings}");
}

#[test]
fn duplicate_names_are_refused() {
    toml(&format!("{SCENE}[materials.m]\n[materials.m]\n")).refused(&["s.toml:14: duplicate key"]);
    changed("fov_y_deg = 40", "fov_y_deg = 40\nfov_y_deg = 41")
        .refused(&["s.toml:5: duplicate key"]);
}

#[test]
fn malformed_toml_is_refused() {
    changed("= [0, 0, 0]", "= [0, 0").refused(&["s.toml:", "help: "]);
    changed("[camera]", "[camera").refused(&["s.toml:1: ", "1 | [camera"]);
    changed("40", "4o").refused(&["s.toml:4: ", "4 | fov_y_deg = 4o"]);
    let deep = format!("a = {}", "[".repeat(100_000));
    toml(&deep).refused(&["s.toml:1: "]);
}

#[test]
fn unknown_keys_and_values_are_refused() {
    toml(&format!("{SCENE}\n[materials.m]\nalbdo = 0.5\n")).refused(&[
        "s.toml:15: unknown key `albdo`",
        "15 | albdo = 0.5",
        "help: use one of `type`, `albedo`, `albedo_texture`",
    ]);
    changed("[[mesh]]", "[[meshes]]").refused(&["s.toml:6: unknown key `meshes`", "`mesh`"]);
    changed("target", "targets").refused(&["s.toml:3: unknown key `targets`", "`target`"]);
    changed("intensity", "watts").refused(&["unknown key `watts`", "`intensity`"]);
    changed("\"point\"", "\"lamp\"").refused(&["unknown value `lamp`", "`point`", "`spot`"]);
    toml(&format!("{SCENE}[render]\nradiu = 1\n"))
        .refused(&["s.toml:14: unknown key `radiu`", "`radius`"]);
    toml(&format!("{SCENE}[render]\ndirect = \"x\"\n"))
        .refused(&["s.toml:14: unknown value `x`", "`connect` or `photon-map`"]);
    toml(&format!("{SCENE}[materials.m]\ntype = \"glass\"\n")).refused(&[
        "s.toml:14: unknown value `glass`",
        "`lambertian`",
        "`metal`",
    ]);
}

#[test]
fn missing_keys_are_refused() {
    toml("").refused(&["s.toml", "the key `camera` is missing", "docs/reference/scene-format.md"]);
    changed("position = [0, 0, 5]\nt", "t").refused(&["s.toml:1: the key `position` is missing"]);
    changed("file = \"a.obj\"\n", "").refused(&["s.toml:6: the key `file` is missing"]);
    changed("position = [0, 0, 5]\ni", "i").refused(&["the key `position` is missing"]);
}

#[test]
fn values_of_wrong_types_are_refused() {
    changed("= [0, 0, 5]", "= \"here\"")
        .refused(&["s.toml:2: wrong type: string \"here\"", "3 numbers"]);
    changed("= [0, 0, 5]", "= [0, 5]").refused(&["s.toml:2: the list has 2 numbers", "give 3"]);
    changed("= [0, 0, 5]", "= 5").refused(&["s.toml:2: a single number stands for a point"]);
    for (list, count) in [("[]", 0), ("[1]", 1), ("[1, 2, 3]", 3)] {
        toml(&format!("{SCENE}[render]\nresolution = {list}\n"))
            .refused(&[&format!("s.toml:14: the list has {count} entries"), "give 2"]);
    }
    toml(&format!("{SCENE}[regions]\nr = [[0, 0, 1, 1, 1]]\n"))
        .refused(&["s.toml:14: the list has 5 entries", "give 4"]);
    changed("\"a.obj\"", "3").refused(&["s.toml:7: wrong type: integer `3`", "give a string"]);
    changed("40", "true").refused(&["s.toml:4: wrong type: boolean `true`", "give a number"]);
    toml(&format!("{SCENE}[render]\nlight_paths = 1e5\n"))
        .refused(&["s.toml:14: wrong type: floating point `100000.0`", "a whole number"]);
    toml(&format!("{SCENE}[render]\nradius = true\n"))
        .refused(&["s.toml:14: wrong type: boolean `true`", "0.8%"]);
}

#[test]
fn values_out_of_range_are_refused() {
    for (line, problem, advice) in [
        ("resolution = [0, 512]", "the resolution is 0x512 pixels", "such as 512x512"),
        ("resolution = [512, 70000]", "the resolution is 512x70000", "65536"),
        ("light_paths = 0", "0 light paths", "between 1"),
        ("camera_paths = 0", "0 camera paths", "at least 1"),
        ("radius = 0", "the merge radius is 0", "0.8%"),
        ("radius = \"big\"", "`big` is not a length", "0.8%"),
        ("merge_vertex = 0", "merge vertex 0", "1 to 255"),
        ("medium_share = 0", "0 of the merges in media are done", "such as 0.1"),
        ("medium_scale = 0", "the radii in media are 0 times", "such as 2"),
        ("wavelength_width = 2", "wavelengths merge within 2 of the spectrum", "such as 0.06"),
        ("guide = 5000", "5000 iterations to learn a guide", "such as 32"),
        ("seed = -1", "wrong value: integer `-1`", "help: give "),
    ] {
        let place = format!("s.toml:14: {problem}");
        toml(&format!("{SCENE}[render]\n{line}\n")).refused(&[&place, line, advice]);
    }
    for value in ["1.5", "-0.1", "nan", "[0.5, 0.5, 2]"] {
        let text = format!("{SCENE}[materials.m]\nalbedo = {value}\n");
        toml(&text).refused(&["s.toml:14: ", "14 | albedo", "help: give "]);
    }
    toml(&format!("{SCENE}[materials.m]\nemission = -1\n"))
        .refused(&["s.toml:14: light is negative"]);
    for rectangle in ["[0, 0, 0, 1]", "[0, 0, 1, 1.5]", "[0.5, 0, 0.2, 1]", "[nan, 0, 1, 1]"] {
        let text = format!("{SCENE}[regions]\nr = [{rectangle}]\n");
        toml(&text).refused(&["s.toml:14: the rectangle", "x0 < x1"]);
    }
    toml(&format!("{SCENE}[regions]\nr = []\n")).refused(&["s.toml:14: the region has no"]);
}

#[test]
fn contradictory_materials_are_refused() {
    let with = |lines: &str| toml(&format!("{SCENE}[materials.m]\n{lines}\n"));
    with("type = \"mirror\"\nalbedo = 0.5")
        .refused(&["s.toml:15: a material of type `mirror` has no `albedo`", "`reflectance`"]);
    with("ior = 1.5").refused(&["s.toml:14: a material of type `lambertian` has no `ior`"]);
    with("type = \"metal\"\nmetal = \"tin\"")
        .refused(&["s.toml:15: unknown metal `tin`", "`gold`"]);
    with("type = \"metal\"\nmetal = \"gold\"\nreflectance = 1")
        .refused(&["s.toml:15: the metal is described twice", "one of `metal`"]);
    with("type = \"metal\"\neta = 1\nk = 1\nreflectance = 1").refused(&["s.toml:17: the metal is"]);
    with("type = \"metal\"\neta = 1").refused(&["s.toml:15: `eta` has no `k`"]);
    with("type = \"metal\"\nk = 1").refused(&["s.toml:15: `k` has no `eta`"]);
    with("type = \"glossy\"\nmetallic = 2").refused(&["s.toml:15: the metallic share is out"]);
    with("metallic_roughness_texture = \"a.png\"").refused(&["s.toml:14: a material of type"]);
    with("normal_scale = 2").refused(&["s.toml:14: `normal_scale` has no `normal_texture`"]);
    for key in ["normal_texture", "emission_texture", "opacity_texture"] {
        with(&format!("{key} = \"a.png\"")).refused(&["s.toml:14: there is no texture `a.png`"]);
    }
    with("texture_wrap = \"stretch\"").refused(&[
        "s.toml:14: unknown value `stretch`",
        "`repeat`",
        "`mirror`",
        "`clamp`",
    ]);
    with("texture_wrap = [\"clamp\"]").refused(&["s.toml:14: ", "two words, for u and v"]);
    with("normal_texture = { wrap = \"clamp\" }")
        .refused(&["s.toml:14: the key `file` is missing"]);
    with("normal_texture = { file = \"a.png\", flip = 1 }")
        .refused(&["s.toml:14: unknown key `flip`", "use one of `file`, `wrap`, `filter`"]);
    with("normal_texture = 3")
        .refused(&["s.toml:14: wrong type", "the name of a file, or a table"]);
    with("type = \"glossy\"\nalpha = 0.3\nroughness = 0.5").refused(&["`alpha` and `roughness`"]);
    with("texture_filter = 3").refused(&["s.toml:14: ", "help: "]);
    with("type = \"coated\"\nroughness = 0.1").refused(&["s.toml:15: a material of type `coated`"]);
    for (line, part) in [
        ("ior = 0", "the refractive index is out of range"),
        ("ior = nan", "the refractive index is out of range"),
        ("outside_ior = -1", "such as 1.5 for glass"),
        ("roughness = 1.5", "the roughness is out of range"),
        ("ior = \"glass\"", "unknown medium `glass`"),
        ("ior = \"glass\"", "use one of `N-BK7`"),
        ("ior = { d = 1.5 }", "the table does not describe a refractive index"),
        ("ior = { d = 1.5, abbe = 60, cauchy = [1.5] }", "give `d` and `abbe`, or `cauchy`"),
        ("ior = { d = 1.5, abe = 60 }", "unknown key `abe`"),
        ("ior = { nanometers = [400, 500], values = [1.5] }", "1 values at 2 wavelengths"),
        ("ior = { nanometers = [500, 400], values = [1.5, 1.6] }", "do not grow"),
        ("ior = { sellmeier = [[1, 0.2]] }", "the refractive index is"),
        ("ior = [1.5, 1.6]", "wrong type"),
    ] {
        with(&format!("type = \"dielectric\"\n{line}")).refused(&["s.toml:15: ", line, part]);
    }
}

#[test]
fn malformed_numbers_of_mtl_materials_are_refused() {
    for (line, part) in [
        ("Ks 1", ""),
        ("d -halo 1", ""),
        ("Ks 0.1 x", "`Ks` needs three numbers"),
        ("Ks -1", "`Ks` is negative"),
        ("Ns shiny", "`Ns` is no number from 0"),
        ("Ns nan", "`Ns` is no number"),
        ("Ni -2", "`Ni` is no number"),
        ("Pr 2", "`Pr` is no number from 0 to 1"),
        ("Pm", "`Pm` is no number"),
        ("d 2", "`d` is no number"),
        ("illum 11", "`illum` is no number"),
    ] {
        let file = mtl(&format!("newmtl m\n{line}\n"));
        if part.is_empty() {
            file.load();
        } else {
            file.refused(&["a.mtl:2: ", line, part]);
        }
    }
}

#[test]
fn impossible_cameras_are_refused() {
    changed("target = [0, 0, 0]\n", "")
        .refused(&["s.toml:1: the camera needs exactly one of `target`"]);
    changed("fov_y_deg = 40", "fov_y_deg = 40\nfov_x_deg = 40")
        .refused(&["s.toml:1: the camera needs exactly one of `fov_x_deg`"]);
    changed("target = [0, 0, 0]", "target = [0, 0, 5]")
        .refused(&["s.toml:1: ", "parallel or zero"]);
    changed("40", "180").refused(&["s.toml:1: the camera's field of view is 180"]);

    let camera = |kind: &str, rest: &str| {
        let keys = format!("type = \"{kind}\"\n{rest}");
        changed("[camera]", &format!("[camera]\n{keys}"))
    };
    camera("thin-lens", "aperture_radius = 0.1").load();
    camera("thin-lens", "").refused(&["s.toml:1: ", "\"thin-lens\" needs `aperture_radius`"]);
    camera("thin-lens", "aperture_radius = 0").refused(&["s.toml:1: ", "aperture_radius is 0"]);
    camera("pinhole", "focus_distance = 1").refused(&[
        "s.toml:1: ",
        "\"pinhole\" has no `focus_distance`",
        "type = \"thin-lens\"",
    ]);
    camera("sensor", "").refused(&[
        "s.toml:1: ",
        "\"sensor\" has no `fov_y_deg`",
        "or \"thin-lens\"",
    ]);
    camera("lens", "").refused(&["s.toml:2: ", "lens", "thin-lens"]);
    camera("fisheye", "").refused(&["s.toml:1: ", "\"fisheye\" has no `fov_y_deg`"]);
    let other = |kind: &str, keys: &str| {
        let head = format!("[camera]\ntype = \"{kind}\"");
        toml(&SCENE.replace("[camera]", &head).replace("fov_y_deg = 40", keys))
    };
    other("fisheye", "").load();
    other("fisheye", "projection = \"equisolid\"\nfov_deg = 220").load();
    other("fisheye", "projection = \"conic\"").refused(&[
        "s.toml:1: ",
        "no fisheye projection `conic`",
        "`equidistant`, `equisolid`",
    ]);
    other("fisheye", "fov_deg = 400").refused(&["s.toml:1: ", "400 degrees", "at most 360"]);
    other("panorama", "").load();
    other("panorama", "shift = [0.1, 0]").refused(&["s.toml:1: ", "turn its direction"]);
    other("orthographic", "height = 3").load();
    other("orthographic", "").refused(&["s.toml:1: ", "exactly one of `width` and `height`"]);
    other("orthographic", "width = 0").refused(&["s.toml:1: ", "width is 0"]);
    let sensor = SCENE
        .replace("[camera]", "[camera]\ntype = \"sensor\"\nsensor_width = 0.03")
        .replace("fov_y_deg = 40", "disc_distance = 0.05");
    toml(&sensor).refused(&["s.toml:1: ", "needs `disc_radius`"]);
    toml(&sensor.replace("0.05", "0.05\ndisc_radius = 0.01")).load();
    toml(&sensor.replace("0.05", "0.05\ndisc_radius = 0.01\nexposure = -1"))
        .refused(&["s.toml:1: ", "exposure is -1"]);
}

#[test]
fn impossible_transforms_and_unknown_materials_are_refused() {
    let with = |line: &str| changed("\"a.obj\"", &format!("\"a.obj\"\n{line}"));
    with("scale = 0").refused(&["s.toml:6: the transform flattens the mesh"]);
    with("translate = 5").refused(&["s.toml:6: `translate` is a single number"]);
    with("scale = 1e30").refused(&["s.toml:6: its transform moves it out of the range"]);
    let matrix = "matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    for (from, to, count) in [("0,1]]", "0,1,0]]", 5), ("],[0,0,0,1]", "]", 3)] {
        let problem = format!("s.toml:8: the list has {count} entries");
        with(&matrix.replace(from, to)).refused(&[&problem, "give 4"]);
    }
    with(&format!("{matrix}\nscale = 2")).refused(&["s.toml:6: the mesh has a `matrix` besides"]);
    with(&matrix.replace("0,1]]", "0,2]]")).refused(&["s.toml:6: the last row"]);
    with("material = \"x\"").refused(&["s.toml:8: unknown material `x`", "[materials.x]"]);
    let known = SCENE.replace("\"a.obj\"", "\"a.obj\"\nmaterial = \"x\"") + "[materials.known]\n";
    toml(&known).refused(&["s.toml:8: unknown material `x`", "use one of `known`"]);
}

#[test]
fn impossible_lights_are_refused() {
    let light = |text: &str| {
        let [before, _] = SCENE.split("[[light]]").collect::<Vec<_>>()[..] else { unreachable!() };
        toml(&format!("{before}[[light]]\n{text}"))
    };
    let refused = |text: &str, parts: &[&str]| {
        light(text).refused(&[&["s.toml:9: "], parts].concat());
    };
    let point = "type = \"point\"\nposition = [0, 0, 5]\n";
    refused(point, &["exactly one of `intensity`, `power`, `candela`, `lumen`"]);
    refused(&format!("{point}power = 1\nlumen = 1\n"), &["exactly one of"]);
    light(&format!("{point}lumen = 800\n")).load();
    let spot = "type = \"spot\"\nposition = [0, 0, 5]\npower = 1\n";
    let aimed = format!("{spot}direction = [0, 0, -1]\n");
    light(&format!("{aimed}outer_deg = 30\n")).load();
    refused(&format!("{spot}outer_deg = 30\n"), &["exactly one of `target` and `direction`"]);
    refused(&format!("{aimed}outer_deg = 91\n"), &["inner_deg = 0, outer_deg = 91"]);
    refused(&format!("{aimed}outer_deg = 9\ninner_deg = 9\n"), &["inner_deg = 9, outer_deg = 9"]);
    let aimless = aimed.replace("-1", "0");
    refused(&format!("{aimless}outer_deg = 30\n"), &["direction has no length"]);
    let sun = "type = \"sun\"\ndirection = [0, 0, -1]\n";
    refused(sun, &["exactly one of `irradiance`, `lux`"]);
    light(&format!("{sun}lux = 100000\n")).load();
    refused(&format!("{sun}lux = 1\nposition = [0, 0, 1]\n"), &["unknown key `position`"]);
}

#[test]
fn scenes_without_light_are_refused() {
    let dark = SCENE.split("[[light]]").next().unwrap();
    toml(dark).refused(&["s.toml: the scene has no light", "`[[light]]`", "`emission`"]);
    changed("intensity = 10", "intensity = 0").refused(&["s.toml: the scene has no light"]);
    changed("intensity = 10", "intensity = 3e38").refused(&["s.toml: the power of all lights"]);
}

#[test]
fn binary_files_are_refused() {
    let bytes: Vec<u8> =
        (0..4096_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    files(&[("a.obj", &bytes)]).refused(&["a.obj:", "not a text file"]);
    files(&[("a.toml", &bytes)]).refused(&["a.toml:", "not UTF-8 text"]);
    files(&[("a.toml", b"a = \"\xff\"")]).refused(&["a.toml:1: this is not UTF-8 text"]);
    let text: Vec<u8> = bytes.iter().map(|b| b | 1).collect();
    files(&[("a.obj", &text)]).refused(&["a.obj"]);
}

#[test]
fn absurd_counts_are_refused_or_summarized() {
    let libraries: String = (0..2000).map(|i| format!("mtllib {i}.mtl\n")).collect();
    obj(&libraries).refused(&["a.obj:1001: more than 1000 material libraries", "fewer MTL files"]);
    // Objects and materials are stored once each. Few of many unknown records are reported.
    let many: String =
        (0..50_000).map(|i| format!("o {i}\nusemtl {i}\nf 1 2 3\nx{i} 1\n")).collect();
    let loaded = obj(&format!("{TRIANGLE}{many}{many}")).load();
    assert_eq!(loaded.scene.meshes().len(), 50_001);
    assert_eq!(loaded.scene.materials().len(), 50_001);
    assert_eq!(loaded.scene.triangle_count(), 100_001);
    assert!(
        loaded.warnings.len() < 10 && loaded.warnings_text().len() < 5000,
        "{:?}",
        loaded.warnings
    );
}

#[test]
fn endless_lines_are_refused() {
    let line = "v ".to_owned() + &"1".repeat(2 << 20);
    obj(&line).refused(&["a.obj:1: the line is longer than 1048576 bytes", "split it"]);
    let comment = format!("{SCENE}# {}", "x".repeat(17 << 20));
    toml(&comment).refused(&["s.toml: the scene file is larger than 16 MiB", "OBJ files"]);
}

#[test]
fn files_with_spaces_byte_order_marks_and_windows_line_ends_load() {
    let folder = TempDir::new().unwrap();
    let inner = folder.path().join("my scene é");
    std::fs::create_dir(&inner).unwrap();
    let dos = |text: &str| format!("\u{feff}{}", text.replace('\n', "\r\n"));
    std::fs::write(inner.join("my lib.mtl"), dos("newmtl my red\nKd 0.5 0 0\n")).unwrap();
    let obj = dos(&format!("mtllib my lib.mtl\no my thing\nusemtl my red\n{TRIANGLE}"));
    std::fs::write(inner.join("my model.OBJ"), obj).unwrap();
    let scene = dos(&SCENE.replace("a.obj", "my model.OBJ"));
    std::fs::write(inner.join("scene.toml"), scene).unwrap();
    let scene = load(&inner).unwrap_or_else(|e| panic!("{e}")).scene;
    assert_eq!(scene.name, "my scene é");
    assert_eq!(scene.meshes()[0].name, "my thing");
    assert_eq!(scene.materials()[0].name, "my red");
    assert_eq!(scene.materials()[0].bsdf.albedo().to_array(), [0.5, 0.0, 0.0]);
}
