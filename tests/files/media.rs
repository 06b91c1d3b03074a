//! Media of scene files: what they become, and what is wrong with them.

use bdpm::Scene;
use bdpm::load::load;
use glam::Vec3;
use std::sync::Arc;
use tempfile::TempDir;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const SCENE: &str = r#"
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
fov_y_deg = 40

[[mesh]]
file = "a.obj"
material = "m"

[[light]]
type = "point"
position = [0, 0, 5]
intensity = 10
"#;

/// The scene with lines before its first table, and tables after the others.
fn scene(head: &str, tables: &str) -> Result<Arc<Scene>, String> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.toml");
    std::fs::write(folder.path().join("a.obj"), TRIANGLE).unwrap();
    std::fs::write(&path, format!("{head}{SCENE}{tables}")).unwrap();
    load(&path).map(|loaded| loaded.scene).map_err(|error| error.to_string())
}

#[test]
fn media_have_the_coefficients_of_their_keys() {
    let glass = "[materials.m]\ntype = 'dielectric'\ninterior = 'a'\n";
    let medium = |keys: &str| {
        let scene = scene("", &format!("{glass}[media.a]\n{keys}")).unwrap();
        scene.media().unwrap().media()[0].clone()
    };
    let both = medium("absorption = [1, 2, 3]\nscattering = 4\nasymmetry = 0.5\npriority = -2");
    assert_eq!((both.absorption, both.scattering), (Vec3::new(1.0, 2.0, 3.0), Vec3::splat(4.0)));
    assert_eq!((both.asymmetry, both.priority), (0.5, -2));
    let colored = medium("color = [0.5, 1, 0]\ndistance = 2");
    let left = colored.transmittance(2.0);
    assert!(left.distance(Vec3::new(0.5, 1.0, 0.0)) < 1e-5, "{left}");
    let cloud = medium("extinction = 2\nalbedo = [1, 0.5, 0]");
    assert_eq!(cloud.scattering, Vec3::new(2.0, 1.0, 0.0));
    assert_eq!(cloud.absorption, Vec3::new(0.0, 1.0, 2.0));
}

#[test]
fn medium_between_all_objects_has_a_name() {
    let fog = "[media.fog]\nscattering = 1\n[materials.m]\nalbedo = 0.5\n";
    let filled = scene("medium = 'fog'", fog).unwrap();
    assert_eq!(filled.filling_medium().unwrap().name, "fog");
    // Media that nothing uses have no effect.
    assert!(scene("", fog).unwrap().media().is_none());
}

#[test]
fn media_that_are_not_described_are_refused() {
    let glass = "[materials.m]\ntype = 'dielectric'\ninterior = 'a'\n";
    let chalk = "[materials.m]\nalbedo = 0.5\n[media.a]\nscattering = 1\n";
    let with = |keys: &str| format!("{glass}[media.a]\n{keys}");
    for (head, tables, part) in [
        ("", with(""), "the medium is not described, or twice"),
        ("", with("absorption = 1\ncolor = 0.5\ndistance = 1"), "or twice"),
        ("", with("color = 0.5"), "give `absorption`"),
        ("", with("color = 0.5\ndistance = 0"), "`distance` is 0"),
        ("", with("scattering = -1"), "the coefficient is out of range"),
        ("", with("scattering = 1\nasymmetry = 1"), "`asymmetry` is 1"),
        ("", with("density = 1"), "unknown key"),
        ("", glass.to_owned(), "unknown medium `a`"),
        (
            "",
            format!("{chalk}[materials.n]\ninterior = 'a'"),
            "of type `lambertian` has no `interior`",
        ),
        ("medium = 'b'", chalk.to_owned(), "use one of `a`"),
        (
            "medium = 'a'",
            format!("{chalk}[environment]\nradiance = 1"),
            "absorbs all light of environments",
        ),
    ] {
        let error = scene(head, &tables).expect_err(part);
        assert!(error.contains(part) && error.contains("\nhelp: "), "{part}: {error}");
    }
}
