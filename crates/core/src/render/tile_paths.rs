//! Iterator over the camera paths of neighboring tiles, pixel by pixel.

use super::measured_pixels::PixelFilter;
use crate::film::counts::CameraCounts;
use crate::film::tiled_buffer::Tile;
use crate::transport::camera_paths::CameraPathId;

/// The current camera path and all that follow it.
#[derive(Clone, Debug)]
pub struct TilePaths<'a> {
    /// Index of the path's pixel among those of all tiles.
    pub pixel: usize,
    /// Number of the path within the pixel.
    pub path: u32,
    /// Number of paths of the pixel that contribute to the image: the first ones.
    pub in_image: u32,
    /// Number of paths of the pixel that are traced; 0 at the end.
    pub traced: u32,
    /// Column and row of the pixel.
    position: (u32, u32),
    tile: Tile,
    /// Tiles after `tile`.
    tiles: &'a [Tile],
    counts: &'a CameraCounts,
    /// Minimum number of paths per pixel: two if the pixel is measured.
    min_paths: u32,
    /// Width and height of the image, pixels.
    image: (u32, u32),
    /// Pixels whose paths are visited.
    filter: PixelFilter,
}

impl<'a> TilePaths<'a> {
    /// All paths of the pixels of `tiles` that pass `filter`. The tiles belong to an image of this
    /// width and height, pixels; at least `min_paths` in each pixel.
    ///
    /// # Panics
    /// If there is no tile.
    pub fn new(
        tiles: &'a [Tile],
        counts: &'a CameraCounts,
        min_paths: u32,
        image: (u32, u32),
        filter: PixelFilter,
    ) -> Self {
        let (&tile, tiles) = tiles.split_first().expect("there is a tile");
        let (pixel, path, in_image, traced) = (0, 0, 0, 0);
        let position = tile.pixel(0);
        let mut paths = Self {
            pixel,
            path,
            in_image,
            traced,
            position,
            tile,
            tiles,
            counts,
            min_paths,
            image,
            filter,
        };
        paths.enter_pixel();
        paths
    }

    /// Whether all paths are done.
    pub fn is_done(&self) -> bool {
        self.traced == 0
    }

    /// Index of the pixel in the image, in row order.
    pub fn image_index(&self) -> usize {
        let (x, y) = self.position;
        (y * self.image.0 + x) as usize
    }

    /// Moves to the next path.
    ///
    /// # Panics
    /// If all paths are done.
    #[inline]
    pub fn advance(&mut self) {
        self.path += 1;
        if self.path == self.traced {
            self.leave_pixel();
        }
    }

    #[inline]
    fn leave_pixel(&mut self) {
        if self.move_to_next_pixel() {
            self.enter_pixel();
        } else {
            self.traced = 0;
        }
    }

    /// Moves to the next pixel, if there is one.
    #[inline]
    fn move_to_next_pixel(&mut self) -> bool {
        self.pixel += 1;
        let (x, y) = &mut self.position;
        let [end_x, end_y] = self.tile.end();
        *x += 1;
        if *x == end_x {
            *y += 1;
            *x = self.tile.pixel(0).0;
            if *y == end_y {
                let Some((tile, tiles)) = self.tiles.split_first() else { return false };
                (self.tile, self.tiles) = (*tile, tiles);
                self.position = tile.pixel(0);
            }
        }
        true
    }

    /// Enters this pixel, or the first one after it that passes the filter.
    #[inline]
    fn enter_pixel(&mut self) {
        while !self.filter.includes(self.position, self.image) {
            if !self.move_to_next_pixel() {
                self.traced = 0;
                return;
            }
        }
        self.path = 0;
        self.in_image = self.counts.at(self.image_index());
        self.traced = self.in_image.max(self.min_paths);
    }
}

impl Iterator for TilePaths<'_> {
    type Item = CameraPathId;

    #[inline]
    fn next(&mut self) -> Option<CameraPathId> {
        (!self.is_done()).then(|| {
            let (x, y) = self.position;
            let id = CameraPathId { x, y, index: self.path };
            self.advance();
            id
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tiled_buffer::tiles;

    #[test]
    fn tile_paths_visit_each_path_of_each_pixel() {
        let tiles: Vec<Tile> = tiles((35, 20)).collect();
        let each: Vec<u32> = (0..35 * 20).map(|pixel| 1 + pixel % 4).collect();
        for counts in [CameraCounts::Uniform(3), CameraCounts::PerPixel(each)] {
            let mut paths = TilePaths::new(&tiles[1..], &counts, 2, (35, 20), PixelFilter::All);
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
