//! Images of layers: what volumes are fetched from.

use std::sync::Arc;

use ash::vk;

use super::{Device, Named};
use crate::error::GpuError;

/// A 2D image of several layers, all of which shaders see.
pub(crate) struct Layers {
    device: Arc<Device>,
    raw: vk::Image,
    memory: vk::DeviceMemory,
    view: vk::ImageView,
    size_bytes: u64,
}

impl Layers {
    /// An image of `[width, height, layers]`; its contents are undefined.
    pub fn new(
        device: &Arc<Device>,
        what: &'static str,
        [width, height, layers]: [u32; 3],
        format: vk::Format,
    ) -> Result<Self, GpuError> {
        let create = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D {
                width,
                height,
                depth: 1,
            })
            .mip_levels(1)
            .array_layers(layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST);
        let name = device.name();
        // SAFETY: callers keep within the device's limits on sides and layers.
        let raw = match unsafe { device.raw().create_image(&create, None) } {
            Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY) => {
                let texels = u64::from(width) * u64::from(height) * u64::from(layers);
                return Err(device.too_little(what, texels));
            }
            other => other.named("making an image", name)?,
        };
        let mut image = Self {
            device: device.clone(),
            raw,
            memory: vk::DeviceMemory::null(),
            view: vk::ImageView::null(),
            size_bytes: 0,
        };
        // SAFETY: the image was just made.
        let needs = unsafe { device.raw().get_image_memory_requirements(raw) };
        let wishes = [
            vk::MemoryPropertyFlags::DEVICE_LOCAL,
            vk::MemoryPropertyFlags::empty(),
        ];
        image.size_bytes = needs.size;
        image.memory = device.allocate(what, needs, &wishes, false)?.0;
        // SAFETY: memory of the size and kind that the image asked for, used for nothing else.
        unsafe { device.raw().bind_image_memory(raw, image.memory, 0) }
            .named("binding memory", name)?;
        let view = vk::ImageViewCreateInfo::default()
            .image(raw)
            .view_type(vk::ImageViewType::TYPE_2D_ARRAY)
            .format(format)
            .subresource_range(image.all());
        // SAFETY: the view covers the image's own layers in its own format.
        image.view = unsafe { device.raw().create_image_view(&view, None) }
            .named("making an image view", name)?;
        Ok(image)
    }

    pub fn raw(&self) -> vk::Image {
        self.raw
    }

    pub fn view(&self) -> vk::ImageView {
        self.view
    }

    /// Bytes on the device.
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// All layers.
    pub fn all(&self) -> vk::ImageSubresourceRange {
        vk::ImageSubresourceRange::default()
            .aspect_mask(vk::ImageAspectFlags::COLOR)
            .level_count(1)
            .layer_count(vk::REMAINING_ARRAY_LAYERS)
    }
}

impl Drop for Layers {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses the image.
        unsafe {
            self.device.raw().destroy_image_view(self.view, None);
            self.device.raw().destroy_image(self.raw, None);
            self.device.raw().free_memory(self.memory, None);
        }
    }
}

/// A sampler that fetches single texels and clamps to the edge.
pub(crate) struct Sampler {
    device: Arc<Device>,
    raw: vk::Sampler,
}

impl Sampler {
    pub fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        let create = vk::SamplerCreateInfo::default()
            .mag_filter(vk::Filter::NEAREST)
            .min_filter(vk::Filter::NEAREST)
            .mipmap_mode(vk::SamplerMipmapMode::NEAREST)
            .address_mode_u(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_v(vk::SamplerAddressMode::CLAMP_TO_EDGE)
            .address_mode_w(vk::SamplerAddressMode::CLAMP_TO_EDGE);
        // SAFETY: a sampler without any extension.
        let raw = unsafe { device.raw().create_sampler(&create, None) }
            .named("making a sampler", device.name())?;
        Ok(Self {
            device: device.clone(),
            raw,
        })
    }

    pub fn raw(&self) -> vk::Sampler {
        self.raw
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses the sampler.
        unsafe { self.device.raw().destroy_sampler(self.raw, None) }
    }
}
