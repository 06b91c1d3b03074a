//! Small files that name much work: trees of includes, instances of instances, subdivision, counts
//! in headers, lists of names without end. Each is refused with its place, within a limit of
//! memory.

#![cfg(target_os = "linux")]

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

/// Address space of the program, KiB: it needs a fraction of it for a small scene.
const LIMIT: &str = "4000000";

/// Runs `bdpm info` on the first of these files with little memory. Returns whether it loads, and
/// the error.
fn run(files: &[(&str, &[u8])]) -> (bool, String) {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in files {
        fs::write(folder.path().join(name), content).unwrap();
    }
    info(&folder.path().join(files[0].0))
}

fn info(path: &Path) -> (bool, String) {
    let limited = format!("ulimit -v {LIMIT} && exec \"$0\" info \"$1\"");
    let mut command = Command::new("sh");
    command.args(["-c", &limited, env!("CARGO_BIN_EXE_bdpm")]).arg(path);
    let output = command.output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    // Signals have no code: memory was exhausted.
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}: {error}", path.display());
    (output.status.success(), error)
}

/// Refused, with all these parts in the error.
#[track_caller]
fn refused(files: &[(&str, &[u8])], parts: &[&str]) {
    let (loads, error) = run(files);
    assert!(!loads);
    for part in parts {
        assert!(error.contains(part), "no `{part}` in: {error}");
    }
}

const PBRT: &str = "Camera \"perspective\"\nWorldBegin\nLightSource \"point\"\n";
const TRIANGLE: &str = "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]\n";

#[test]
fn trees_of_includes_are_refused() {
    let names: Vec<String> = (0..31).map(|k| format!("i{k}.pbrt")).collect();
    let level = |k: usize| format!("Include \"i{}.pbrt\"\n", k + 1).repeat(2);
    let contents: Vec<String> =
        (0..31).map(|k| if k < 30 { level(k) } else { "\n".into() }).collect();
    let main = format!("{PBRT}{TRIANGLE}Include \"i0.pbrt\"\n");
    let mut files = vec![("a.pbrt", main.as_bytes())];
    files.extend(names.iter().zip(&contents).map(|(name, text)| (&name[..], text.as_bytes())));
    refused(&files, &[".pbrt:", "100001 includes repeat", "include each file once"]);
    // Few includes of a large file.
    let spaces = " ".repeat(8 << 20);
    let main = format!("{PBRT}{TRIANGLE}{}", "Include \"b.pbrt\"\n".repeat(90));
    refused(
        &[("a.pbrt", main.as_bytes()), ("b.pbrt", spaces.as_bytes())],
        &["a.pbrt:38: 35 includes repeat 264 MiB"],
    );
}

#[test]
fn shared_attributes_take_no_memory_per_shape() {
    let attribute = format!("Attribute \"shape\" \"float x\" [{}]\n", "1 ".repeat(20_000));
    let main = format!("{PBRT}{attribute}{}", TRIANGLE.repeat(20_000));
    assert!(run(&[("a.pbrt", main.as_bytes())]).0);
    let main = format!("{PBRT}{attribute}{}", "AttributeBegin\n".repeat(99_000));
    refused(&[("a.pbrt", main.as_bytes())], &["a.pbrt:5: the file ends within AttributeBegin"]);
    let main = format!("{PBRT}Attribute \"shape\" {}", "\"float x\" 1 ".repeat(300));
    refused(&[("a.pbrt", main.as_bytes())], &["a.pbrt:4: Attribute adds more than 256 parameters"]);
}

#[test]
fn shapes_and_instances_beyond_memory_are_refused() {
    let main = format!("{PBRT}{}", "Shape \"sphere\"\n".repeat(100_000));
    refused(&[("a.pbrt", main.as_bytes())], &["a.pbrt:", "sphere: the meshes of the scene"]);
    let main = format!(
        "{PBRT}ObjectBegin \"o\"\n{}ObjectEnd\n{}",
        TRIANGLE.repeat(20_000),
        "ObjectInstance \"o\"\n".repeat(100_000)
    );
    refused(&[("a.pbrt", main.as_bytes())], &["a.pbrt:", "o: the meshes of the scene"]);
}

#[test]
fn subdivisions_beyond_memory_are_refused() {
    let grid = |n: usize| {
        let points = (0..n * n).map(|i| format!("{} {} 0 ", i % n, i / n)).collect::<String>();
        let cell = |i: usize| (i / (n - 1)) * n + i % (n - 1);
        let cells = (0..(n - 1) * (n - 1)).map(cell);
        let cells =
            cells.map(|i| format!("{i} {} {} {} {} {i} ", i + 1, i + n + 1, i + n + 1, i + n));
        let cells: String = cells.collect();
        format!("\"point3 P\" [{points}] \"integer indices\" [{cells}]")
    };
    for n in [9, 24, 200] {
        let main = format!("{PBRT}Shape \"loopsubdiv\" \"integer levels\" 8 {}\n", grid(n));
        refused(&[("a.pbrt", main.as_bytes())], &["a.pbrt:4: loopsubdiv: 8 levels make"]);
    }
}

#[test]
fn compressed_files_without_end_are_refused() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    (0..1000).for_each(|_| encoder.write_all(&[b' '; 1 << 20]).unwrap());
    let spaces = encoder.finish().unwrap();
    refused(&[("a.pbrt", &spaces)], &["a.pbrt: cannot decompress it", "over 100 times"]);
    let main = format!("{PBRT}Shape \"plymesh\" \"string filename\" \"a.ply.gz\"\n");
    refused(
        &[("a.pbrt", main.as_bytes()), ("a.ply.gz", &spaces)],
        &["a.ply.gz: cannot read it as a PLY file: the first line is not `ply`"],
    );
    // The name of a shape has no end.
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&[1, 0, 0, 0]).unwrap();
    (0..300).for_each(|_| encoder.write_all(&[b'a'; 1 << 20]).unwrap());
    let shape = encoder.finish().unwrap();
    let shape = [&[0x1c, 4, 4, 0][..], &shape[..], &[0, 0, 0, 0, 1, 0, 0, 0]].concat();
    let scene = "<scene version='3.0.0'><emitter type='constant'/><shape type='serialized'>\
                 <string name='filename' value='n.serialized'/></shape></scene>";
    refused(
        &[("a.xml", scene.as_bytes()), ("n.serialized", &shape)],
        &["n.serialized: ", "the name of a shape has no end"],
    );
}

#[test]
fn substitutions_and_includes_beyond_memory_are_refused() {
    let scene = format!(
        "<scene version='3.0.0'>\n<default name='b' value='{}'/>\n{}</scene>",
        "x".repeat(60_000),
        "<string name='a' value='$b'/>\n".repeat(300_000)
    );
    refused(
        &[("a.xml", scene.as_bytes())],
        &["a.xml:4475: <string>: its values have over 256 MiB"],
    );
    let include = "<include filename='b.xml'/>".repeat(990);
    let scene = format!("<scene version='3.0.0'>{include}</scene>");
    let blank = format!("<scene version='3.0.0'>{}</scene>", " ".repeat(15_000_000));
    let files = [("a.xml", scene.as_bytes()), ("b.xml", blank.as_bytes())];
    refused(&files, &["b.xml: the files of the scene have over 256 MiB"]);
}

#[test]
fn many_elements_of_one_line_load() {
    let sphere = |k: usize| {
        let radius = 1.0 + k as f64 * 1e-4;
        format!("<shape type='sphere'><float name='radius' value='{radius}'/></shape>")
    };
    let spheres: String = (0..4000).map(sphere).collect();
    let scene = format!("<scene version='3.0.0'>{spheres}<emitter type='constant'/></scene>");
    let (loads, error) = run(&[("a.xml", scene.as_bytes())]);
    assert!(loads, "{error}");
}

#[test]
fn photometric_files_with_too_many_values_are_refused() {
    let scene = format!(
        "mesh = [{{ file = 'a.obj' }}]\n{TOML}[[light]]\ntype = 'luminaire'\nposition = [0, 2, 0]\n\
         file = 'a.ies'\n"
    );
    let angles = |last: f64| {
        let angle = |i: u32| (last * f64::from(i) / 2999.0).to_string();
        (0..3000).map(angle).collect::<Vec<_>>().join(" ")
    };
    let ies = format!(
        "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3000 3000 1 2 0 0 0\n1 1 10\n{}\n{}\n{}",
        angles(90.0),
        angles(360.0),
        "1 ".repeat(9_000_000)
    );
    refused(
        &[("a.toml", scene.as_bytes()), ("a.obj", OBJ), ("a.ies", ies.as_bytes())],
        &["a.ies:3: there are 9000000 intensities", "at most 8388608"],
    );
}

const TOML: &str = "[camera]\nposition = [0, 2, 3]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
                    [environment]\nradiance = 1\n";
const OBJ: &[u8] = b"v -1 0 1\nv 1 0 1\nv 0 0 -1\nf 1 2 3\n";

#[test]
fn tables_of_meters_and_places_beyond_memory_are_refused() {
    let meter = "[[meter]]\ncorner = [0, 0, 0]\nedges = [[1, 0, 0], [0, 0, 1]]\ncolumns = 1024\n\
                 rows = 1024\n";
    let scene = format!("mesh = [{{ file = 'a.obj' }}]\n{TOML}{}", meter.repeat(800));
    refused(
        &[("a.toml", scene.as_bytes()), ("a.obj", OBJ)],
        &["a.toml:13: the tables up to here have over 1048576 meters"],
    );
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (50000000, 3, 4), }\n";
    let mut npy = b"\x93NUMPY\x01\x00".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    fs::write(at("p.npy"), &npy).unwrap();
    // A file with a hole takes no space.
    let file = fs::OpenOptions::new().append(true).open(at("p.npy")).unwrap();
    file.set_len(npy.len() as u64 + 48 * 50_000_000).unwrap();
    fs::write(at("a.obj"), OBJ).unwrap();
    let scene = format!("mesh = [{{ file = 'a.obj', places = 'p.npy' }}]\n{TOML}");
    fs::write(at("a.toml"), scene).unwrap();
    let (loads, error) = info(&at("a.toml"));
    assert!(!loads && error.contains("p.npy: reading the places takes about"), "{error}");
}

#[test]
fn media_in_many_objects_load() {
    let count = 60_000;
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({count}, 3, 4), }}\n");
    let places = |x: f32| {
        let mut npy = b"\x93NUMPY\x01\x00".to_vec();
        npy.extend((header.len() as u16).to_le_bytes());
        npy.extend(header.as_bytes());
        for i in 0..count {
            let rows = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 3.0 * i as f32, 0.0, 0.0, 1.0, 0.0];
            npy.extend(rows.iter().flat_map(|number: &f32| number.to_le_bytes()));
        }
        npy
    };
    // No two objects meet, but the boxes around all of each medium do.
    let (a, b) = (places(0.0), places(1.5));
    let body = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    let scene = format!(
        "{TOML}[media.one]\nscattering = 1\n[media.two]\nscattering = 2\n\
         [materials.one]\ntype = 'boundary'\ninterior = 'one'\n\
         [materials.two]\ntype = 'boundary'\ninterior = 'two'\n\
         [[mesh]]\nfile = 'a.obj'\nmaterial = 'one'\nplaces = 'a.npy'\n\
         [[mesh]]\nfile = 'a.obj'\nmaterial = 'two'\nplaces = 'b.npy'\n"
    );
    let (loads, error) =
        run(&[("a.toml", scene.as_bytes()), ("a.obj", body), ("a.npy", &a), ("b.npy", &b)]);
    assert!(loads, "{error}");
}

#[test]
fn counts_of_gltf_instances_beyond_memory_are_refused() {
    let point = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    for (count, vertices) in
        [(4_000_000_000_u64, 3), (30_000_000, 3), (1_000_000_000_000_000_000, 0)]
    {
        let model = format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,
            "extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{"TRANSLATION":1}}}}}}}}],
            "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{point}"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],"accessors":[
            {{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3"}},
            {{"componentType":5126,"count":{count},"type":"VEC3"}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}]}}"#
        );
        refused(&[("a.gltf", model.as_bytes())], &["a.gltf: nodes[0]: the meshes of the scene"]);
    }
}

#[test]
fn headers_of_pictures_and_display_windows_beyond_memory_are_refused() {
    let scene = format!(
        "mesh = [{{ file = 'a.obj', material = 'm' }}]\n{TOML}[materials.m]\n\
         albedo_texture = 'a.png'\n"
    );
    // A PNG of 65,535 squared without content.
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    for (length, chunk) in
        [(13_u32, &b"IHDR\x00\x00\xff\xff\x00\x00\xff\xff\x08\x06\x00\x00\x00"[..]), (0, b"IDAT")]
    {
        png.extend(length.to_be_bytes());
        png.extend(chunk);
        png.extend(crc(chunk).to_be_bytes());
    }
    let files = [("a.toml", scene.as_bytes()), ("a.obj", OBJ), ("a.png", &png[..])];
    refused(&files, &["a.toml:", "65535x65535 texels; at most 16384"]);
}

/// Runs of Radiance pictures name many pixels in few bytes.
#[test]
fn runs_of_pictures_beyond_memory_are_refused() {
    let scene = format!(
        "mesh = [{{ file = 'a.obj' }}]\n{}",
        TOML.replace("radiance = 1", "file = 'a.hdr'")
    );
    let runs = [9, 9, 9, 129, 1, 1, 1, 255, 1, 1, 1, 255].repeat(65_536);
    let hdr = [b"#?RADIANCE\n\n-Y 65536 +X 65536\n", &runs[..]].concat();
    refused(
        &[("a.toml", scene.as_bytes()), ("a.obj", OBJ), ("a.hdr", &hdr)],
        &["a.hdr: cannot read it as an HDR image: its 65536 scanlines of 65536 pixels take"],
    );
}

#[test]
fn files_with_holes_beyond_memory_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["a.hdr", "b.glb"] {
        fs::File::create(at(name)).unwrap().set_len(1 << 42).unwrap();
    }
    fs::write(at("a.obj"), OBJ).unwrap();
    let scene = TOML.replace("radiance = 1", "file = 'a.hdr'");
    fs::write(at("a.toml"), format!("mesh = [{{ file = 'a.obj' }}]\n{scene}")).unwrap();
    for (scene, part) in
        [("a.toml", "a.hdr: reading the file takes"), ("b.glb", "b.glb: reading the file takes")]
    {
        let (loads, error) = info(&at(scene));
        assert!(!loads && error.contains(part), "{error}");
    }
}

/// CRC-32 of a chunk of a PNG file.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| {
            if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 }
        })
    })
}

#[test]
fn names_from_files_do_not_control_the_terminal() {
    let scene = format!("mesh = [{{ file = 'a.obj', material = \"a\\u001b[2Jb\" }}]\n{TOML}");
    let (loads, error) = run(&[("a.toml", scene.as_bytes()), ("a.obj", OBJ)]);
    assert!(!loads && error.contains("unknown material `a\u{fffd}[2Jb`"), "{error}");
    assert!(!error.contains('\x1b'), "{error}");
}
