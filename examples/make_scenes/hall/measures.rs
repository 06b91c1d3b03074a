//! Measures of the hall, in meters. The nave runs along z, its middle is x = 0; it has a row of
//! bays on either side, each with an alcove below and one on the gallery.

/// Bays along each side, and the distance of their columns.
pub const BAYS: usize = 10;
pub const BAY: f64 = 4.2;
/// Half the length of the hall.
pub const END: f64 = 0.5 * BAY * BAYS as f64;
/// From the middle to the axes of the columns, which is also the radius of the vault.
pub const NAVE: f64 = 5.0;
/// From the middle to the outer walls.
pub const WALL: f64 = 9.0;
/// Undersides and floor of the gallery.
pub const GALLERY: f64 = 4.5;
pub const GALLERY_FLOOR: f64 = 5.0;
/// Underside of the entablature, and where the vault begins on it.
pub const ENTABLATURE: f64 = 9.0;
pub const SPRINGING: f64 = 10.0;
/// Walls between the bays: where they begin, and half their thickness.
pub const PARTITION: f64 = 6.2;
pub const PARTITION_HALF: f64 = 0.12;
/// The apse: its radius, and the height of its cylinder.
pub const APSE: f64 = 3.3;
pub const APSE_HEIGHT: f64 = 6.6;

/// The middle of a bay, along z.
pub fn bay(i: usize) -> f64 {
    (i as f64 + 0.5) * BAY - END
}
