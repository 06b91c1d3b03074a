//! `sunsky` of Mitsuba 3, and `sunsky`, `sky` and `sun` of 0.5 and 0.6.

use super::object::Object;
use super::texture::Paints;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_light::sky::{
    HosekWilkie, PlaceAndTime, SUN_HALF_ANGLE, Sky, SkyModel, SunDisc, cone, sun_irradiance,
};
use glam::{DMat3, DVec3};

/// Returns true for the types of this module.
pub(super) fn is_sky(object: &Object) -> bool {
    matches!(object.kind(), "sunsky" | "sky" | "sun")
}

/// Reads a sky, whose `to_world` is this rotation. Returns it with the rotation from its frame, in
/// which +y is up, to the scene.
pub(super) fn read(object: &Object, to_world: DMat3, paints: &mut Paints) -> Result<(Sky, DMat3)> {
    let is_old = object.document.is_old;
    // Mitsuba 3 has +z up and measures azimuths from +x, 0.6 has +y up and -z in the north.
    let local =
        if is_old { DMat3::IDENTITY } else { DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y) };
    let to_world = to_world * local;
    let turbidity = object.float_in("turbidity", 3.0, [1.0, 10.0])?;
    let ground = if is_old { 0.15 } else { 0.3 };
    let albedo = paints.mean_share(object, "albedo", Rgb::splat(ground))?;
    let toward = sun_direction(object, is_old, to_world)?;
    // Of 0.6; the plugin of Mitsuba 3 has no such property.
    let both = if is_old { object.float_in("scale", 1.0, [0.0, 1e30])? } else { 1.0 };
    let scale = |name: &str| object.float_in(name, both, [0.0, 1e30]);
    let [sky_scale, sun_scale] = match object.kind() {
        "sky" => [both, 0.0],
        "sun" => [0.0, both],
        _ => [scale("sky_scale")?, scale("sun_scale")?],
    };
    let degrees = 2.0 * SUN_HALF_ANGLE.to_degrees();
    let aperture = if is_old {
        degrees * object.float_in("sun_radius_scale", 1.0, [0.01, 100.0])?
    } else {
        object.float_in("sun_aperture", degrees, [0.01, 179.0])?
    };
    if object.boolean("complex_sun")?.unwrap_or(false) {
        paints.skipped("used a uniform disc for the sun with a darker limb of", object);
    }
    if is_old && sun_scale > 0.0 {
        paints.skipped("used the sun of Hosek and Wilkie for Preetham's of", object);
    }
    if toward.y < 0.0 {
        paints.skipped("the sun is below the horizon, hence no light comes from", object);
        return Ok((Sky { dome: None, sun: None, ground: Rgb::ZERO }, to_world));
    }
    let model = HosekWilkie::new(turbidity, albedo, toward);
    let dome =
        (sky_scale > 0.0).then(|| (SkyModel::HosekWilkie(model), Rgb::splat(sky_scale as f32)));
    let half_angle = 0.5 * aperture.to_radians();
    let sun = (sun_scale > 0.0).then(|| {
        let radiance = (sun_scale / cone(half_angle)) as f32;
        let radiance = radiance * sun_irradiance(turbidity, toward.y.asin());
        SunDisc { toward, half_angle, radiance }
    });
    // Mitsuba has spectral radiances, beside whose numbers files give those of their lights.
    Ok((Sky { dome, sun, ground: Rgb::ZERO }, to_world))
}

/// Unit vector toward the sun in the frame of the sky.
fn sun_direction(object: &Object, is_old: bool, to_world: DMat3) -> Result<DVec3> {
    if let Some(toward) = object.point("sun_direction")? {
        let toward = (to_world.transpose() * toward).try_normalize();
        let advice = "give a vector that is not zero";
        return toward.ok_or_else(|| object.error("`sun_direction` has no direction", advice));
    }
    let number = |name: &str, default: f64, range| object.float_in(name, default, range);
    let whole = |name: &str, default, range| Ok(number(name, default, range)?.round() as i32);
    let time = [("hour", 15.0), ("minute", 0.0), ("second", 0.0)];
    let time = time.map(|(name, default)| number(name, default, [-1e6, 1e6]));
    let [hour, minute, second] = time;
    let [zenith, azimuth] = PlaceAndTime {
        latitude: number("latitude", 35.6894, [-90.0, 90.0])?,
        longitude: number("longitude", 139.6917, [-360.0, 360.0])?,
        timezone: number("timezone", 9.0, [-24.0, 24.0])?,
        year: whole("year", 2010.0, [-4000.0, 9999.0])?,
        month: whole("month", 7.0, [1.0, 12.0])?,
        day: whole("day", 10.0, [1.0, 31.0])?,
        hours: hour? + minute? / 60.0 + second? / 3600.0,
    }
    .sun();
    let (up, across) = (zenith.cos(), zenith.sin());
    let (sin, cos) = azimuth.sin_cos();
    Ok(if is_old {
        DVec3::new(across * sin, up, -across * cos)
    } else {
        // Mitsuba 3 turns azimuths by 180 degrees: +x is in the south. Its z is our y.
        DVec3::new(-across * cos, up, across * sin)
    })
}
