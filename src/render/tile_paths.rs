//! The camera paths of neighboring tiles, pixel after pixel.

use crate::film::counts::CameraCounts;
use crate::film::radiance::Tile;
use crate::transport::camera_paths::CameraPathId;

/// The camera path that comes next, and those after it.
#[derive(Clone, Debug)]
pub struct TilePaths<'a> {
    /// Index of its pixel among those of all tiles.
    pub pixel: usize,
    /// Its number within the pixel.
    pub path: u32,
    /// How many paths of the pixel are of the image: the first ones.
    pub in_image: u32,
    /// How many are traced; 0 if there is no path left.
    pub traced: u32,
    /// Column and row of the pixel.
    place: (u32, u32),
    tile: Tile,
    /// Those after it.
    tiles: &'a [Tile],
    counts: &'a CameraCounts,
    /// Paths that a pixel has at least: measuring takes two, even where the image takes one.
    least: u32,
    image_width: u32,
}

impl<'a> TilePaths<'a> {
    /// All paths of `tiles` in an image so many pixels wide, at least so many in each pixel.
    ///
    /// # Panics
    /// If there is no tile.
    pub fn new(tiles: &'a [Tile], counts: &'a CameraCounts, least: u32, image_width: u32) -> Self {
        let (&tile, tiles) = tiles.split_first().expect("there is a tile");
        let (pixel, path, in_image, traced) = (0, 0, 0, 0);
        let place = tile.pixel(0);
        let mut paths =
            Self { pixel, path, in_image, traced, place, tile, tiles, counts, least, image_width };
        paths.enter_pixel();
        paths
    }

    /// Whether there is no path left.
    pub fn is_done(&self) -> bool {
        self.traced == 0
    }

    /// Index of the pixel in the image, row by row.
    pub fn image_index(&self) -> usize {
        let (x, y) = self.place;
        (y * self.image_width + x) as usize
    }

    /// Goes on to the next path.
    ///
    /// # Panics
    /// If there was none left.
    #[inline]
    pub fn advance(&mut self) {
        self.path += 1;
        if self.path == self.traced {
            self.leave_pixel();
        }
    }

    #[inline]
    fn leave_pixel(&mut self) {
        self.pixel += 1;
        let (x, y) = &mut self.place;
        let [end_x, end_y] = self.tile.end();
        *x += 1;
        if *x == end_x {
            *y += 1;
            *x = self.tile.pixel(0).0;
            if *y == end_y {
                self.traced = 0;
                let Some((tile, tiles)) = self.tiles.split_first() else { return };
                (self.tile, self.tiles) = (*tile, tiles);
                self.place = tile.pixel(0);
            }
        }
        self.enter_pixel();
    }

    #[inline]
    fn enter_pixel(&mut self) {
        self.path = 0;
        self.in_image = self.counts.at(self.image_index());
        self.traced = self.in_image.max(self.least);
    }
}

impl Iterator for TilePaths<'_> {
    type Item = CameraPathId;

    #[inline]
    fn next(&mut self) -> Option<CameraPathId> {
        (!self.is_done()).then(|| {
            let (x, y) = self.place;
            let id = CameraPathId { x, y, index: self.path };
            self.advance();
            id
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::radiance::Film;

    #[test]
    fn each_pixel_has_all_its_paths() {
        let tiles: Vec<Tile> = Film::new(35, 20).tiles().collect();
        let each: Vec<u32> = (0..35 * 20).map(|pixel| 1 + pixel % 4).collect();
        for counts in [CameraCounts::Uniform(3), CameraCounts::PerPixel(each)] {
            let mut paths = TilePaths::new(&tiles[1..], &counts, 2, 35);
            let mut pixel = 0;
            for tile in &tiles[1..] {
                for (x, y) in (0..tile.len() as u32).map(|index| tile.pixel(index)) {
                    let in_image = counts.at((y * 35 + x) as usize);
                    for index in 0..in_image.max(2) {
                        assert_eq!(
                            (paths.pixel, paths.path, paths.in_image),
                            (pixel, index, in_image)
                        );
                        assert_eq!(paths.traced, in_image.max(2));
                        let id = paths.next().unwrap();
                        assert_eq!((id.x, id.y, id.index), (x, y, index));
                    }
                    pixel += 1;
                }
            }
            assert!(paths.is_done() && paths.next().is_none());
        }
    }
}
