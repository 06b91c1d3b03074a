//! Shows the image in tev by its TCP protocol: an image of named channels is created once, then its
//! pixels are updated. A separate thread sends the pixels, so that a viewer that hangs does not
//! delay the render.

use crate::cli::progress::Progress;
use bdpm::image_io::Layer;
use bdpm::output::denoise::Denoised;
use bdpm::render::block::CombinedImage;
use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// Time to wait for a connection.
const CONNECTING: Duration = Duration::from_secs(1);

/// Time after which a viewer that accepts no data counts as gone, and maximum wait at the end of
/// the program.
const PATIENCE: Duration = Duration::from_secs(5);

/// Pixels for tev.
pub struct Frame {
    size: (u32, u32),
    names: Vec<String>,
    /// Channel after channel.
    values: Vec<f32>,
}

impl Frame {
    /// The image, its noise if that is known, and the denoised image if there is one.
    pub fn new(image: &CombinedImage, denoised: Option<&Denoised>) -> Self {
        let mut layers = vec![Layer::rgb("", &image.mean())];
        let (width, height) = image.resolution();
        let rms = image.rms().unwrap_or_else(|| vec![0.0; width as usize * height as usize]);
        layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        layers.extend(denoised.map(|denoised| Layer::rgb("denoised", &denoised.image)));
        let (mut names, mut values) = (Vec::new(), Vec::new());
        for Layer { name: layer, channels } in layers {
            for (name, channel) in channels {
                names.push(if layer.is_empty() { name } else { format!("{layer}.{name}") });
                values.extend(channel);
            }
        }
        Self { size: (width, height), names, values }
    }
}

/// A thread that sends frames.
pub struct Tev {
    frames: SyncSender<Frame>,
    done: Receiver<()>,
    is_sending: bool,
}

impl Tev {
    /// Shows an image of this name in the viewer at `address`. Warns once if there is no answer,
    /// and tries again with each frame.
    pub fn new(address: &str, name: &str, progress: &Progress) -> Self {
        let (frames, to_send) = sync_channel::<Frame>(1);
        let (sent, done) = sync_channel(1);
        let (address, name, progress) = (address.to_owned(), name.to_owned(), progress.clone());
        std::thread::spawn(move || {
            let (mut connection, mut has_warned) = (None, false);
            while let Ok(frame) = to_send.recv() {
                if let Err(error) = send(&mut connection, &address, &name, &frame) {
                    connection = None;
                    let error = match error.kind() {
                        ErrorKind::WouldBlock | ErrorKind::TimedOut => "no answer".to_owned(),
                        _ => error.to_string(),
                    };
                    if !std::mem::replace(&mut has_warned, true) {
                        progress.note(&format!(
                            "warning: cannot show the image in tev at {address}: {error}\nhelp: start tev, \
                             or give its address by --view=HOST:PORT; rendering goes on"
                        ));
                    }
                }
                if sent.send(()).is_err() {
                    return;
                }
            }
        });
        Self { frames, done, is_sending: false }
    }

    /// Returns true if the thread can take a frame.
    pub fn is_idle(&mut self) -> bool {
        self.is_sending &= self.done.try_recv().is_err();
        !self.is_sending
    }

    /// Sends a frame, or drops it if the previous one is still being sent.
    pub fn send(&mut self, frame: Frame) {
        if self.is_idle() {
            self.is_sending = self.frames.try_send(frame).is_ok();
        }
    }

    /// Waits until the last frame was sent, for a few seconds at most.
    pub fn wait(&mut self) {
        if self.is_sending && self.done.recv_timeout(PATIENCE).is_ok() {
            self.is_sending = false;
        }
    }
}

/// A connection, and the channels of the image there.
type Connection = Option<(TevClient, Vec<String>)>;

fn send(connection: &mut Connection, address: &str, name: &str, frame: &Frame) -> io::Result<()> {
    let (client, channels) = match connection {
        Some(connection) => connection,
        None => connection.insert((TevClient::wrap(connect(address)?), Vec::new())),
    };
    let (width, height) = frame.size;
    if *channels != frame.names {
        client.send(PacketCreateImage {
            image_name: name,
            grab_focus: channels.is_empty(),
            width,
            height,
            channel_names: &frame.names.iter().map(String::as_str).collect::<Vec<_>>(),
        })?;
        channels.clone_from(&frame.names);
    }
    let pixels = u64::from(width) * u64::from(height);
    client.send(PacketUpdateImage {
        image_name: name,
        grab_focus: false,
        channel_names: &frame.names,
        channel_offsets: &(0..frame.names.len() as u64).map(|k| k * pixels).collect::<Vec<_>>(),
        channel_strides: &vec![1; frame.names.len()],
        x: 0,
        y: 0,
        width,
        height,
        data: &frame.values,
    })
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::other("it has no such address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECTING) {
            Ok(stream) => {
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}
