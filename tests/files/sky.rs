//! `[sky]`, insets of environments and `ray_offset` of scene files, and skies of Mitsuba.

use bdpm::base::math::luminance;
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::import::EnvironmentSource;
use bdpm::load::{LoadOptions, Loaded, export, load, load_with};
use glam::Vec3;
use tempfile::TempDir;

const SQUARE: &str = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 4 3 2 1\n";
const HEAD: &str = "camera = { position = [0, 3, 5], target = [0, 0, 0], fov_x_deg = 40 }\n";
const MESH: &str = "[[mesh]]\nfile = 'a.obj'\nmaterial = 'm'\n[materials.m]\n";

fn folder(text: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("a.obj"), SQUARE).unwrap();
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    folder
}

fn read(keys: &str, sky: &str) -> Result<Loaded, String> {
    let folder = folder(&format!("{keys}{HEAD}{MESH}[sky]\n{sky}"));
    load(folder.path().join("a.toml")).map_err(|error| error.to_string())
}

/// Irradiance of the horizontal, W/m^2, by sampled connections, and its standard error.
fn horizontal(loaded: &Loaded) -> [f64; 2] {
    use bdpm::base::rng::{Stream, StreamKey};
    use bdpm::scene::Receiver;
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let n = 100_000;
    let (mut sum, mut square) = (0.0, 0.0);
    let at = Receiver { position: Vec3::ZERO, normal: Some(Vec3::Y) };
    for _ in 0..n {
        let sample = loaded.scene.lights().connect(at, &mut rng);
        let value = sample.map_or(0.0, |s| f64::from(luminance(s.irradiance) * s.wi.y.max(0.0)));
        sum += value / f64::from(n);
        square += value * value / f64::from(n);
    }
    [sum, ((square - sum * sum) / f64::from(n)).sqrt()]
}

/// Illuminance of the horizontal, lx, and its standard error.
fn horizontal_lx(loaded: &Loaded) -> [f64; 2] {
    horizontal(loaded).map(|watts| watts * f64::from(LUMENS_PER_WATT))
}

#[test]
fn skies_have_the_given_illuminance_in_the_given_direction() {
    let sun = Vec3::new(0.6, 0.64, -0.48);
    let place = "sun_direction = [0.6, 0.64, -0.48]\n";
    for (keys, direct, diffuse) in [
        ("model = 'cie'\ncie_type = 12\ndiffuse_lx = 9e3\ndirect_lx = 5e4\n", 5e4, 9e3),
        ("model = 'cie'\ncie_type = 1\ndiffuse_lx = 9e3\n", 0.0, 9e3),
        ("model = 'perez'\ndiffuse_lx = 13e3\ndirect_lx = 4e4\nsun_angle_deg = 4\n", 4e4, 13e3),
    ] {
        let loaded = read("", &[place, keys].concat()).unwrap();
        let [found, error] = horizontal_lx(&loaded);
        let expected = diffuse + direct * f64::from(sun.y);
        // Pixels near the horizon are coarse.
        assert!((found - expected).abs() < 4.0 * error + 3e-3 * expected, "{keys} {found} {error}");
        let toward = luminance(loaded.scene.lights().environment_radiance(sun));
        assert_eq!(toward > 100.0, direct > 0.0, "{keys}: {toward}");
        assert_eq!(loaded.scene.lights().environment_radiance(Vec3::NEG_Y), Vec3::ZERO);
    }
}

/// Weather data in watts per square meter become lux by the luminous efficacy of Perez et al. 1990,
/// which is 95 to 120 lm/W on ordinary days.
#[test]
fn irradiances_of_weather_data_have_the_efficacy_of_daylight() {
    let place = "sun_direction = [0.6, 0.64, -0.48]\n";
    for (model, diffuse, direct) in [
        ("model = 'perez'\n", 100.0, 800.0),
        ("model = 'perez'\n", 200.0, 0.0),
        ("model = 'cie'\ncie_type = 12\n", 100.0, 700.0),
    ] {
        let keys = format!("{place}{model}diffuse = {diffuse}\ndirect = {direct}\n");
        let [found, _] = horizontal_lx(&read("", &keys).unwrap());
        let efficacy = found / (diffuse + direct * 0.64);
        assert!((95.0..120.0).contains(&efficacy), "{keys}: {found} lx, {efficacy} lm/W");
    }
}

/// Illuminance of the horizontal under clear skies. The bounds are 15 % around the values for clear
/// skies of the IES (Handbook, 9th edition, section 8: direct illuminance `127,500 exp(-0.21 m)` lx
/// times the sine of the solar altitude with the air mass `m`, and diffuse illuminance
/// `800 + 15,500 sqrt(sin)` lx).
#[test]
fn clear_skies_have_published_illuminances_at_five_places_and_hours() {
    for (latitude, longitude, timezone, date, hour) in [
        (52.5, 13.4, 2.0, [2025, 6, 21], 13.0), // Berlin
        (52.5, 13.4, 2.0, [2025, 3, 31], 10.0),
        (1.35, 103.8, 8.0, [2025, 3, 21], 13.0), // Singapore
        (40.7, -74.0, -5.0, [2025, 12, 21], 12.0), // New York
        (-33.9, 151.2, 11.0, [2025, 1, 15], 16.0), // Sydney
    ] {
        let keys = format!(
            "latitude = {latitude}\nlongitude = {longitude}\ntimezone = {timezone}\ndate = {date:?}\n\
             hour = {hour}\nturbidity = 2.5\n"
        );
        let loaded = read("", &keys).unwrap();
        let [found, error] = horizontal_lx(&loaded);
        let sin = sun_height(&loaded);
        let degrees = sin.asin().to_degrees();
        let air_mass = 1.0 / (sin + 0.50572 * (degrees + 6.07995).powf(-1.6364));
        let expected = 127_500.0 * (-0.21 * air_mass).exp() * sin + 800.0 + 15_500.0 * sin.sqrt();
        println!(
            "{latitude} {hour}: sun {degrees:.1} degrees, {found:.0} +- {error:.0} lx, {expected:.0} lx"
        );
        assert!((found / expected - 1.0).abs() < 0.15, "{keys}: {found}, not {expected}");
    }
}

/// Sine of the altitude of the sun: the brightest of a lattice of directions.
fn sun_height(loaded: &Loaded) -> f64 {
    let environment = loaded.scene.lights().environment().unwrap();
    let n = 1500;
    let mut best = (0.0, 0.0);
    for i in 0..n {
        let y = ((i as f32 + 0.5) / n as f32 * std::f32::consts::FRAC_PI_2).sin();
        let across = (1.0 - y * y).sqrt();
        for j in 0..2 * n {
            let (sin, cos) = (j as f32 / (2 * n) as f32 * std::f32::consts::TAU).sin_cos();
            let radiance =
                luminance(environment.radiance(Vec3::new(across * cos, y, across * sin)));
            if radiance > best.0 {
                best = (radiance, f64::from(y));
            }
        }
    }
    best.1
}

#[test]
fn overcast_skies_need_no_sun() {
    for kind in [1, 3, 5] {
        let keys = format!("model = 'cie'\ncie_type = {kind}\ndiffuse_lx = 10000\n");
        let [found, error] = horizontal_lx(&read("", &keys).unwrap());
        assert!((found - 1e4).abs() < 4.0 * error + 30.0, "{kind}: {found} {error}");
    }
    for (keys, part) in [
        ("model = 'cie'\ncie_type = 2\ndiffuse_lx = 1e4", "does not know where the sun is"),
        ("model = 'cie'\ncie_type = 1\ndiffuse_lx = 1e4\ndirect_lx = 5", "where the sun is"),
        ("model = 'cie'\ncie_type = 1\ndiffuse = 100", "give `diffuse_lx` in place of `diffuse`"),
        ("model = 'perez'\ndiffuse_lx = 1e4\ndirect_lx = 0", "does not know where the sun is"),
    ] {
        let error = read("", keys).map(|_| ()).expect_err(keys);
        assert!(error.contains(part), "{keys}: {error}");
    }
}

/// A ground of this albedo has the radiance of a diffuse plane under the sky and the sun.
#[test]
fn ground_of_an_albedo_reflects_the_light_of_sky_and_sun() {
    let place = "sun_direction = [0.6, 0.64, -0.48]\n";
    for keys in [
        "model = 'cie'\ncie_type = 12\ndiffuse_lx = 9e3\ndirect_lx = 5e4\nalbedo = 0.2\n",
        "albedo = [0.2, 0.2, 0.2]\n",
        "albedo = 0.2\nsky_scale = 0\n",
    ] {
        let loaded = read("", &[place, keys].concat()).unwrap();
        let [irradiance, _] = horizontal(&loaded);
        let down = Vec3::new(0.3, -0.5, 0.2).normalize();
        let ground = f64::from(luminance(loaded.scene.lights().environment_radiance(down)));
        let expected = 0.2 * irradiance / std::f64::consts::PI;
        assert!((ground / expected - 1.0).abs() < 0.01, "{keys}: {ground}, not {expected}");
    }
}

#[test]
fn given_sky_lights_files_that_have_none() {
    let sky = "model = 'cie', cie_type = 1, diffuse_lx = 10000";
    let source = EnvironmentSource::sky(sky).unwrap();
    let folder = folder(&format!("{HEAD}{MESH}[environment]\nradiance = 1\n"));
    let options = LoadOptions { environment: Some(&source), ..LoadOptions::default() };
    for name in ["a.toml", "a.obj"] {
        let [found, _] = horizontal_lx(&load_with(&folder.path().join(name), &options).unwrap());
        assert!((found / 1e4 - 1.0).abs() < 0.01, "{name}: {found}");
    }
    for (keys, part) in
        [("model = 'dark'", "unknown variant"), ("turbidity = 3", "where the sun is")]
    {
        let error = EnvironmentSource::sky(keys).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains("help: "), "{keys}: {error}");
    }
}

#[test]
fn sun_of_a_place_is_in_the_south_at_noon_and_turns_with_the_sky() {
    let place = "latitude = 50\nlongitude = 0\ntimezone = 0\ndate = [2024, 3, 20]\nhour = 12.12\n";
    for (turn, toward) in [("", Vec3::Z), ("turn_deg = 90\n", Vec3::X)] {
        let loaded = read("", &[place, turn].concat()).unwrap();
        let (sin, cos) = 40_f32.to_radians().sin_cos();
        let radiance = |w: Vec3| luminance(loaded.scene.lights().environment_radiance(w));
        let sun = radiance((cos * toward + sin * Vec3::Y).normalize());
        assert!(sun > 100.0 * radiance((-cos * toward + sin * Vec3::Y).normalize()), "{sun}");
    }
}

#[test]
fn skies_and_offsets_survive_a_conversion() {
    let loaded = read("ray_offset = 1e-3\n", "sun_direction = [1, 1, 0]\nturbidity = 4\n").unwrap();
    let out = TempDir::new().unwrap();
    export(&loaded, "a.toml", out.path(), true).unwrap();
    let again = load(out.path()).unwrap();
    assert_eq!(again.scene.fingerprint(), loaded.scene.fingerprint());
    assert_eq!(again.scene.own_ray_offset(), Some(1e-3));
    let plain = read("", "sun_direction = [1, 1, 0]\nturbidity = 4\n").unwrap();
    assert_ne!(plain.scene.fingerprint(), loaded.scene.fingerprint());
}

#[test]
fn wrong_skies_are_refused_with_advice() {
    for (sky, part) in [
        ("", "does not know where the sun is"),
        ("sun_direction = [0, 0, 0]", "`sun_direction` has no length"),
        ("sun_direction = [1, -1, 0]", "45.0 degrees below the horizon"),
        ("sun_direction = [1, 1, 0]\nhour = 3", "besides a place"),
        ("sun_direction = [1, 1, 0]\nturbidity = 11", "`turbidity` is 11"),
        ("sun_direction = [1, 1, 0]\ndiffuse = 11", "no meaning for this model"),
        ("sun_direction = [1, 1, 0]\nmodel = 'cie'\ndiffuse = 1", "needs `cie_type`"),
        ("sun_direction = [1, 1, 0]\nmodel = 'cie'\ndiffuse = 1\ncie_type = 17", "type 17"),
        (
            "sun_direction = [1, 1, 0]\nmodel = 'perez'\ndiffuse = 1\ndirect = 1e4",
            "no sky of Perez",
        ),
        ("date = [2024, 13, 1]", "`date` is [2024, 13, 1]"),
    ] {
        let error = read("", sky).map(|_| ()).expect_err(sky);
        assert!(error.contains(part) && error.contains("help: "), "{sky}: {error}");
    }
    let error = read("ray_offset = -1\n", "sun_direction = [1, 1, 0]").map(|_| ()).unwrap_err();
    assert!(error.contains("`ray_offset` is -1"), "{error}");
    let both = "sun_direction = [1, 1, 0]\n[environment]\nradiance = 1\n";
    let error = read("", both).map(|_| ()).unwrap_err();
    assert!(error.contains("both [environment] and [sky]"), "{error}");
}

/// The sun of a Mitsuba file: the brightest of all directions.
fn mitsuba_sun(version: &str, emitters: &str) -> Vec3 {
    let folder = TempDir::new().unwrap();
    let text = format!(
        "<scene version='{version}'><sensor type='perspective'><transform name='to_world'>\
         <lookat origin='0, 0, 5' target='0, 0, 0' up='0, 1, 0'/></transform></sensor>\
         {emitters}<shape type='rectangle'/></scene>"
    );
    std::fs::write(folder.path().join("a.xml"), text).unwrap();
    let loaded = load(folder.path().join("a.xml")).unwrap();
    let environment = loaded.scene.lights().environment().unwrap().clone();
    let mut best = (0.0, Vec3::ZERO);
    let n = 400;
    for i in 0..n {
        for j in 0..4 * n {
            let y = (i as f32 + 0.5) / n as f32;
            let (sin, cos) = (j as f32 / (4 * n) as f32 * std::f32::consts::TAU).sin_cos();
            let across = (1.0 - y * y).sqrt();
            let w = Vec3::new(across * cos, y, across * sin);
            let radiance = luminance(environment.radiance(w));
            if radiance > best.0 {
                best = (radiance, w);
            }
        }
    }
    best.1
}

#[test]
fn skies_of_old_mitsuba_files_have_y_up_and_may_be_in_two_parts() {
    let sky =
        "<emitter type='sky'><vector name='sunDirection' x='0.6' y='0.64' z='-0.48'/></emitter>";
    let sun = "<emitter type='sun'><vector name='sunDirection' x='0.6' y='0.64' z='-0.48'/>\
               <float name='sunRadiusScale' value='8'/></emitter>";
    for emitters in [[sky, sun].concat(), [sun, sky].concat()] {
        let toward = mitsuba_sun("0.6.0", &emitters);
        assert!(toward.dot(Vec3::new(0.6, 0.64, -0.48)) > 0.998, "{toward}");
    }
    // In Mitsuba 3, +z is up. The scene is turned so that it is +y.
    let emitter = "<emitter type='sunsky'><vector name='sun_direction' x='0.6' y='0.48' z='0.64'/>\
                   <float name='sun_aperture' value='4'/></emitter>";
    let toward = mitsuba_sun("3.0.0", emitter);
    assert!(toward.dot(Vec3::new(0.6, 0.64, -0.48)) > 0.998, "{toward}");
}

#[test]
fn radiances_of_the_sky_that_overflow_are_refused() {
    for key in ["sun_scale = 1e38", "sky_scale = 3e38", "sun_scale = 1e33\nsun_angle_deg = 0.01"] {
        let error = read("", &format!("sun_direction = [0, 1, 0]\n{key}")).unwrap_err();
        assert!(error.contains("a.toml:"), "{error}");
        assert!(error.contains("overflows"), "{key}: {error}");
    }
}

/// The inset of a small sun at the pole is a whole row of fine pixels.
#[test]
fn smallest_sun_at_the_zenith_has_its_irradiance() {
    let irradiance = |angle: &str| {
        let text = format!("sun_direction = [0, 1, 0]\nsky_scale = 0\n{angle}");
        let scene = read("", &text).unwrap().scene;
        f64::from(luminance(scene.lights().power()))
    };
    let (small, whole) = (irradiance("sun_angle_deg = 0.01"), irradiance(""));
    assert!((small / whole - 1.0).abs() < 1e-2, "{small}, not {whole}");
}

#[test]
fn sun_below_the_horizon_is_refused_with_advice_about_keys() {
    let error = read("", "sun_direction = [0, -1, 0]").unwrap_err();
    assert!(error.contains("90.0 degrees below the horizon"), "{error}");
    assert!(error.contains("help: change `hour`, `date` or `sun_direction`"), "{error}");
}

#[test]
fn wavelengths_that_are_no_numbers_are_refused() {
    for (nanometers, problem) in [
        ("[nan, nan]", "a wavelength of the refractive index is NaN"),
        ("[400, inf]", "a wavelength of the refractive index is inf"),
        ("[-1, 500]", "a wavelength of the refractive index is -1"),
        ("[500, 400]", "do not grow"),
    ] {
        let folder = folder(&format!(
            "{HEAD}{MESH}type = 'dielectric'\nior = {{ nanometers = {nanometers}, values = [1.5, 1.5] }}\n\
             [environment]\nradiance = 1\n"
        ));
        let error = load(folder.path().join("a.toml")).unwrap_err().to_string();
        assert!(error.contains("a.toml:7") && error.contains(problem), "{error}");
    }
}

#[test]
fn media_without_coefficients_are_empty_space_under_a_sky() {
    let scene = |coefficients: &str| {
        let folder = folder(&format!(
            "medium = 'air'\n{HEAD}{MESH}[environment]\nradiance = 1\n[media.air]\n{coefficients}\n"
        ));
        load(folder.path().join("a.toml")).map_err(|error| error.to_string())
    };
    assert!(scene("scattering = 0").unwrap().scene.filling_medium().is_none());
    let error = scene("scattering = 0.1").unwrap_err();
    assert!(error.contains("absorbs all light of environments"), "{error}");
}

#[test]
fn powers_that_overflow_name_their_light() {
    let scene = |lights: &str, emission: &str| {
        let folder = folder(&format!("{HEAD}{MESH}emission = {emission}\n{lights}"));
        load(folder.path().join("a.toml")).unwrap_err().to_string()
    };
    let error = scene("", "3e38");
    assert!(error.contains("overflows; the material `m` has the largest emission"), "{error}");
    let point = "[[light]]\ntype = 'point'\nposition = [1, 2, 3]\nintensity = 3e38\n";
    let error = scene(point, "0");
    assert!(error.contains("overflows; the strongest light is at [1, 2, 3]"), "{error}");
    let error = scene("[environment]\nradiance = 3e38\n", "0");
    assert!(error.contains("overflows; the environment is the strongest"), "{error}");
}
