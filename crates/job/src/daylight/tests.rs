//! Daylight of single hours against closed forms, and against the meters of [`MeasureJob`].

use super::*;
use crate::MeasureJob;
use crate::measurement::Estimated;
use bdpm_core::base::math::uniform_sphere;
use bdpm_core::base::rng::{Stream, StreamKey};
use bdpm_light::weather::WeatherHour;
use std::ops::ControlFlow;

/// Noon of a summer day in Munich, on the clock of Central European Time.
const NOON: WeatherHour =
    WeatherHour { month: 6, day: 21, middle: 12.5, diffuse: 150.0, direct: 700.0 };

fn weather(hour: WeatherHour) -> Weather {
    let (latitude, longitude, timezone) = (48.1, 11.6, 1.0);
    Weather { place: "Munich, DEU".into(), latitude, longitude, timezone, hours: vec![hour] }
}

/// A scene of these files; `scene.toml` is one of them.
fn loaded(files: &[(&str, &str)]) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    bdpm_load::load(folder.path()).unwrap()
}

const CAMERA: &str = "[camera]\nposition = [2, 1.5, 2]\ntarget = [2, 1.5, 3]\nfov_x_deg = 60\n";

fn means(loaded: &Loaded, hour: WeatherHour, paths: u64) -> Vec<Estimated> {
    let job = DaylightJob::new(loaded, weather(hour)).paths(paths);
    let year = job.run(|_| ()).unwrap();
    assert_eq!(year.occupied_hours, 1);
    year.sets.iter().map(|set| set.mean).collect()
}

/// Without anything around, a meter that faces up has the light of the weather, and one that faces
/// down that of the ground.
#[test]
fn meters_in_the_open_have_the_light_of_the_weather() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"far.obj\"\n\
         [[meter]]\nname = \"up\"\nposition = [0, 1, 0]\nnormal = [0, 1, 0]\n\
         [[meter]]\nname = \"down\"\nposition = [0, 1, 0]\nnormal = [0, -1, 0]\n"
    );
    let far = "v 0 -900 0\nv 0.01 -900 0\nv 0 -900 0.01\nf 1 2 3\n";
    let loaded = loaded(&[("scene.toml", &scene), ("far.obj", far)]);
    let patches = SkyPatches::new(DIVISION);
    for direct in [0.0, 700.0] {
        let hour = WeatherHour { direct, ..NOON };
        let weather = weather(hour);
        let year = Year::new(&weather, &patches, 0.0, 0.2).unwrap();
        let own = &year.hours[0];
        let sky: f64 = (0..patches.count())
            .map(|patch| f64::from(own.sky[patch]) * patches.projected(patch))
            .sum();
        let sun = own.sun.map_or(0.0, |sun| f64::from(sun.lux * sun.toward.y));
        let [up, down] = means(&loaded, hour, 50_000)[..] else { panic!("two meters") };
        let expected = sky + sun;
        assert!((up.value - expected).abs() < 2.0 * up.expanded + 1e-3 * expected, "{up:?}");
        assert!(up.expanded < 0.01 * expected, "{up:?}");
        let ground = 0.2 * expected;
        assert!((down.value - ground).abs() < 1e-4 * ground, "{down:?} {ground}");
    }
}

/// A module that faces the sky has the irradiances of the weather.
#[test]
fn irradiation_is_that_of_the_weather() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"far.obj\"\n\
         [[meter]]\nname = \"front\"\nposition = [0, 1, 0]\nnormal = [0, 1, 0]\n\
         [[meter]]\nname = \"back\"\nposition = [0, 1, 0]\nnormal = [0, -1, 0]\n"
    );
    let far = "v 0 -900 0\nv 0.01 -900 0\nv 0 -900 0.01\nf 1 2 3\n";
    let loaded = loaded(&[("scene.toml", &scene), ("far.obj", far)]);
    let weather = weather(NOON);
    let height = weather.sun(&NOON).y;
    let year = DaylightJob::new(&loaded, weather).ground(0.3).paths(50_000).run(|_| ()).unwrap();
    let expected = 1e-3 * (NOON.diffuse + NOON.direct * height);
    let [front, back] = [0, 1].map(|set: usize| year.sets[set].points[0].irradiation);
    assert!((front.value - expected).abs() < 2.0 * front.expanded + 1e-4, "{front:?} {expected}");
    assert!((back.value - 0.3 * expected).abs() < 1e-4 * expected, "{back:?}");
}

/// A room with a window to the south: the same hour by a sky with a sun, measured by photons and
/// paths. Both intervals are of 95 %; patches of 10 degrees blur sky and sun, which is allowed 3 %.
#[test]
fn an_hour_in_a_room_agrees_with_a_measurement_under_its_sky() {
    let room = "v 0 0 0\nv 4 0 0\nv 4 0 5\nv 0 0 5\nv 0 3 0\nv 4 3 0\nv 4 3 5\nv 0 3 5\n\
                v 1 1 5\nv 3 1 5\nv 3 2.5 5\nv 1 2.5 5\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\n\
                f 1 5 8 4\nf 2 3 7 6\nf 4 9 10 3\nf 3 10 11 7\nf 7 11 12 8\nf 8 12 9 4\n";
    let scene = format!(
        "{CAMERA}[[mesh]]\nfile = \"room.obj\"\nmaterial = \"wall\"\n\
         [materials.wall]\nalbedo = 0.6\n\
         [sky]\nmodel = \"perez\"\nlatitude = 48.1\nlongitude = 11.6\ntimezone = 1\n\
         date = [2023, 6, 21]\nhour = 12.5\ndiffuse = 150\ndirect = 700\nalbedo = 0.2\n\
         [[meter]]\nname = \"desk\"\nposition = [2, 0.75, 2]\nnormal = [0, 1, 0]\n\
         [[meter]]\nname = \"wall\"\nposition = [2, 1.5, 0.001]\nnormal = [0, 0, 1]\n"
    );
    let loaded = loaded(&[("scene.toml", &scene), ("room.obj", room)]);
    let measured =
        MeasureJob::new(&loaded).target(0.02).run(|_| ControlFlow::Continue(())).unwrap();
    let year = means(&loaded, NOON, 100_000);
    for (set, own) in measured.sets.iter().zip(year) {
        let other = set.mean;
        let noise = own.expanded.hypot(other.expanded);
        let difference = (own.value - other.value).abs();
        assert!(difference < 1.5 * noise + 0.03 * other.value, "{}: {own:?} {other:?}", set.name);
        // The reflected sun is most of it.
        let overcast = means(&loaded, WeatherHour { direct: 0.0, ..NOON }, 20_000);
        assert!(overcast[0].value < 0.7 * own.value || set.name == "wall", "{overcast:?}");
    }
}

/// A meter faces a mirror of 90 % with its back to the sun: the sun shines on it by the mirror, as
/// evenly from its patch of the sky. Behind a pane without a mirror it is not counted twice.
#[test]
fn mirrors_send_the_sun_to_meters() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"mirror.obj\"\nmaterial = \"it\"\n\
         [materials.it]\ntype = \"mirror\"\nreflectance = 0.9\n\
         [[meter]]\nposition = [0, 1, 0]\nnormal = [0, 0, -1]\n"
    );
    let mirror = "v -900 -900 -1\nv 900 -900 -1\nv 900 900 -1\nv -900 900 -1\nf 1 2 3 4\n";
    let loaded = loaded(&[("scene.toml", &scene), ("mirror.obj", mirror)]);
    for division in [1, 2] {
        let patches = SkyPatches::new(division);
        let of = |direct: f64| {
            let job = DaylightJob::new(&loaded, weather(WeatherHour { direct, ..NOON }));
            job.division(division).ground(0.0).paths(400_000).run(|_| ()).unwrap().sets[0].mean
        };
        let sun = weather(NOON).sun(&NOON);
        let patch = patches.find(sun).unwrap();
        // Mean cosine of the patch at the meter, by the mirror, where it stands to the south.
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        let (mut sum, mut count) = (0.0, 0.0);
        for _ in 0..400_000 {
            let direction = uniform_sphere(rng.next_2d()).as_dvec3();
            if patches.find(direction) == Some(patch) {
                (sum, count) = (sum + direction.z.max(0.0), count + 1.0);
            }
        }
        let year = Year::new(&weather(NOON), &patches, 0.0, 0.0).unwrap();
        let lux = f64::from(year.hours[0].sun.unwrap().lux);
        let expected = 0.9 * lux * sum / count;
        // The sky of an hour without sun differs, so it is taken from its luminances.
        let sky = year.hours[0].sky[..patches.count()].iter().enumerate();
        let sky: f64 = sky
            .map(|(patch, own)| {
                let toward = patches.middle(patch).z.max(0.0);
                0.9 * f64::from(*own) * toward * patches.solid_angle(patch)
            })
            .sum();
        let found = of(NOON.direct);
        let off = found.value - sky - expected;
        println!("{found:?} {sky} {expected}");
        assert!(off.abs() < 2.0 * found.expanded + 0.01 * expected, "{off}");
        assert!(found.expanded < 0.1 * expected, "{found:?}");
    }
}

/// Glass that absorbs light would let all of it through.
#[test]
fn media_are_refused() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"far.obj\"\nmaterial = \"ink\"\n\
         [materials.ink]\ntype = \"dielectric\"\ninterior = \"ink\"\n\
         [media.ink]\nabsorption = 1.0\n\
         [[meter]]\nposition = [0, 1, 0]\nnormal = [0, 1, 0]\n"
    );
    let far = "v 0 -9 0\nv 1 -9 0\nv 0 -9 1\nf 1 2 3\n";
    let loaded = loaded(&[("scene.toml", &scene), ("far.obj", far)]);
    let error = DaylightJob::new(&loaded, weather(NOON)).paths(1).run(|_| ()).unwrap_err();
    assert!(error.to_string().contains("has a medium"), "{error}");
}

#[test]
fn meters_of_luminance_and_impossible_numbers_are_refused() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"far.obj\"\n\
         [[meter]]\nposition = [0, 1, 0]\ndirection = [0, 1, 0]\n"
    );
    let far = "v 0 -9 0\nv 1 -9 0\nv 0 -9 1\nf 1 2 3\n";
    let loaded = loaded(&[("scene.toml", &scene), ("far.obj", far)]);
    let job = DaylightJob::new(&loaded, weather(NOON)).paths(1);
    let refused = |job: DaylightJob| job.run(|_| ()).unwrap_err().to_string();
    assert!(refused(job.clone()).contains("measures luminance"));
    assert!(refused(job.clone().meters(Vec::new())).contains("no meters"));
    let up = Meter::irradiance(glam::Vec3::ZERO, glam::Vec3::Y).unwrap();
    let job = job.meters(vec![MeterSet::single("up", MeterKind::Irradiance, up)]);
    assert!(job.clone().run(|_| ()).is_ok());
    assert!(refused(job.clone().ground(1.5)).contains("ground"));
    assert!(refused(job.clone().turned(f64::NAN)).contains("turn"));
    assert!(refused(job.clone().division(5)).contains("577"));
    let thresholds = Thresholds { autonomy: -1.0, ..Thresholds::default() };
    assert!(refused(job.thresholds(thresholds)).contains("autonomy"));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let scene = format!(
        "{CAMERA}[environment]\nradiance = 1\n[[mesh]]\nfile = \"far.obj\"\n\
         [[meter]]\nposition = [0, 1, 0]\nnormal = [0, 1, 1]\n"
    );
    let far = "v -9 0 -9\nv -9 0 9\nv 9 0 -9\nf 1 2 3\n";
    let loaded = loaded(&[("scene.toml", &scene), ("far.obj", far)]);
    let mean = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let job = DaylightJob::new(&loaded, weather(NOON)).paths(5000).threads(Arc::new(pool));
        job.run(|_| ()).unwrap().sets[0].mean
    };
    assert_eq!(mean(1), mean(3));
}
