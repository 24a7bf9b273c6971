// Fuses frames whose images are memory that another device or process exported.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <bit>
#include <cstdlib>
#include <cstring>

#include "api_subject.h"
#include "engine/instance.h"
#include "faults.h"

namespace raymeld::test {
namespace {

constexpr VkExternalMemoryHandleTypeFlagBits kOpaque = VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT;

// Exports memory from a device that raymeld does not know.
class Exporter {
 public:
  const CallerDevice& caller() const { return caller_; }
  bool can_export() const {
    auto info =
        vk_struct<VkPhysicalDeviceExternalBufferInfo>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_EXTERNAL_BUFFER_INFO);
    info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    info.handleType = kOpaque;
    auto found = vk_struct<VkExternalBufferProperties>(VK_STRUCTURE_TYPE_EXTERNAL_BUFFER_PROPERTIES);
    const ExternalDevice& device = caller_.external();
    caller_.vk().GetPhysicalDeviceExternalBufferProperties(device.physical_device, &info, &found);
    return device.external_memory_fd && (found.externalMemoryProperties.externalMemoryFeatures &
                                         VK_EXTERNAL_MEMORY_FEATURE_EXPORTABLE_BIT);
  }

 private:
  CallerDevice caller_;
};

// Holds mapped memory, which each call of desc() exports anew.
class Exported {
 public:
  Exported(const CallerDevice& caller, size_t floats, uint64_t offset_bytes = 0)
      : vk_(caller.vk()), device_(caller.external().device) {
    auto external =
        vk_struct<VkExternalMemoryBufferCreateInfo>(VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO);
    external.handleTypes = kOpaque;
    auto info = vk_struct<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, &external);
    info.size = offset_bytes + floats * sizeof(float);
    info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    check(vk_.CreateBuffer(device_, &info, nullptr, &buffer_), "creating a buffer");
    VkMemoryRequirements needs;
    vk_.GetBufferMemoryRequirements(device_, buffer_, &needs);
    auto exports = vk_struct<VkExportMemoryAllocateInfo>(VK_STRUCTURE_TYPE_EXPORT_MEMORY_ALLOCATE_INFO);
    exports.handleTypes = kOpaque;
    auto allocation = vk_struct<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &exports);
    allocation.allocationSize = needs.size;
    allocation.memoryTypeIndex = host_visible(caller, needs.memoryTypeBits);
    check(vk_.AllocateMemory(device_, &allocation, nullptr, &memory_), "allocating");
    check(vk_.BindBufferMemory(device_, buffer_, memory_, 0), "binding");
    void* mapped = nullptr;
    check(vk_.MapMemory(device_, memory_, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping");
    values_ = {reinterpret_cast<float*>(static_cast<char*>(mapped) + offset_bytes), floats};
    desc_.handle_type = kOpaque;
    desc_.memory_size_bytes = allocation.allocationSize;
    desc_.memory_type_index = allocation.memoryTypeIndex;
    desc_.offset_bytes = offset_bytes;
    desc_.size_bytes = floats * sizeof(float);
  }
  Exported(const CallerDevice& caller, const std::vector<float>& values, uint64_t offset_bytes = 0)
      : Exported(caller, values.size(), offset_bytes) {
    std::ranges::copy(values, values_.begin());
  }
  ~Exported() {
    vk_.DestroyBuffer(device_, buffer_, nullptr);
    vk_.FreeMemory(device_, memory_, nullptr);
  }
  Exported(const Exported&) = delete;
  Exported& operator=(const Exported&) = delete;

  std::span<float> values() const { return values_; }

  raymeld_import_desc desc() const {
    raymeld_import_desc desc = desc_;
    auto info = vk_struct<VkMemoryGetFdInfoKHR>(VK_STRUCTURE_TYPE_MEMORY_GET_FD_INFO_KHR);
    info.memory = memory_;
    info.handleType = kOpaque;
    const auto get =
        reinterpret_cast<PFN_vkGetMemoryFdKHR>(vk_.GetDeviceProcAddr(device_, "vkGetMemoryFdKHR"));
    check(get(device_, &info, &desc.fd), "exporting");
    return desc;
  }

 private:
  static uint32_t host_visible(const CallerDevice& caller, uint32_t allowed) {
    VkPhysicalDeviceMemoryProperties memory;
    caller.vk().GetPhysicalDeviceMemoryProperties(caller.external().physical_device, &memory);
    constexpr VkMemoryPropertyFlags kWanted =
        VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    for (uint32_t i = 0; i < memory.memoryTypeCount; ++i)
      if ((allowed & 1u << i) && (memory.memoryTypes[i].propertyFlags & kWanted) == kWanted) return i;
    throw Error("no memory that the host sees");
  }

  const VulkanFunctions& vk_;
  VkDevice device_;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  std::span<float> values_;
  raymeld_import_desc desc_;
};

bool is_open(int fd) { return fcntl(fd, F_GETFD) >= 0; }

raymeld_image image_of(const ImportedBuffer& buffer) {
  raymeld_image image;
  image.buffer = buffer.info().buffer;
  return image;
}

// Fuses the imported images twice, through raymeld's own submits.
void fuse_imported(const Context& context, Fusion& fusion, const raymeld_import_desc (&descs)[3]) {
  const ImportedBuffer lrhs(context, descs[0]), hrls(context, descs[1]), fused(context, descs[2]);
  const raymeld_image images[] = {image_of(lrhs), image_of(hrls), image_of(fused)};
  raymeld_frame frame;
  frame.lrhs = &images[0];
  frame.hrls = &images[1];
  frame.fused = &images[2];
  for (int i = 0; i < 2; ++i) fusion.submit(frame);
  EXPECT_EQ(fusion.take_status().not_finite, 0u);
}

class ImportTest : public testing::Test {
 protected:
  ImportTest() {
    set_cache_home(folder_ / "cache");
    write_model(file_, subject_.architecture, subject_.weights);
  }

  // Returns a context with a device of raymeld's own, on the physical device that the exporter has.
  static Context own_context(const CallerDevice& exporter) {
    const std::string uuid = device_info(exporter.vk(), exporter.external().physical_device, 0).uuid;
    raymeld_context_desc desc;
    desc.selector = uuid.c_str();
    return Context(desc);
  }

  std::vector<float> lrhs() const { return floats(subject_.lrhs); }
  std::vector<float> hrls() const { return floats(subject_.hrls); }
  static constexpr size_t kFusedSize = 3 * 12 * 18;

  TemporaryDirectory folder_;
  std::string file_ = folder_ / "model.safetensors";
  Subject subject_ = make_subject(small_architecture(2), 6, 9, 1);
};

TEST_F(ImportTest, FusesWhatAnotherDeviceExported) {
  const Exporter exporter;
  if (!exporter.can_export()) GTEST_SKIP() << "the device exports no buffers";
  const CallerDevice importer;
  for (const bool own : {false, true}) {
    SCOPED_TRACE(own ? "a device of raymeld's" : "a device of the caller's");
    const Context context = own ? own_context(exporter.caller()) : Context(context_desc(importer.external()));
    Fusion fusion(context, SharedModel(file_), fusion_desc(subject_));
    const std::vector<float> expected = fuse(fusion, subject_).values;
    for (const uint64_t offset_bytes : {0, 1024}) {
      const Exported lrhs(exporter.caller(), this->lrhs(), offset_bytes),
          hrls(exporter.caller(), this->hrls(), offset_bytes),
          fused(exporter.caller(), kFusedSize, offset_bytes);
      const raymeld_import_desc descs[] = {lrhs.desc(), hrls.desc(), fused.desc()};
      fuse_imported(context, fusion, descs);
      EXPECT_TRUE(same_bits(fused.values(), expected)) << offset_bytes;
    }
  }
}

// Sends the description of an export to another process, and its file descriptor beside it.
void send_export(int socket, raymeld_import_desc desc) {
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  iovec content{&desc, sizeof(desc)};
  msghdr message{};
  message.msg_iov = &content;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  cmsghdr* const header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(header), &desc.fd, sizeof(int));
  if (sendmsg(socket, &message, 0) != sizeof(desc)) throw Error("sending: {}", std::strerror(errno));
  close(desc.fd);
}

raymeld_import_desc receive_export(int socket) {
  raymeld_import_desc desc;
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  iovec content{&desc, sizeof(desc)};
  msghdr message{};
  message.msg_iov = &content;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  if (recvmsg(socket, &message, MSG_CMSG_CLOEXEC) != sizeof(desc)) throw Error("nothing was received");
  std::memcpy(&desc.fd, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof(int));
  return desc;
}

TEST_F(ImportTest, FusesWhatAnotherProcessExported) {
  int sockets[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sockets), 0);
  enum : char { kCannot, kReady, kDone };
  const pid_t child = fork();  // the process has no device yet
  ASSERT_GE(child, 0);
  if (child == 0) {
    try {
      close(sockets[0]);
      const Exporter exporter;
      const char can = exporter.can_export() ? kReady : kCannot;
      if (write(sockets[1], &can, 1) != 1 || can == kCannot) _exit(1);
      const Exported lrhs(exporter.caller(), this->lrhs()), hrls(exporter.caller(), this->hrls()),
          fused(exporter.caller(), kFusedSize);
      for (const Exported* each : {&lrhs, &hrls, &fused}) send_export(sockets[1], each->desc());
      char done = kCannot;
      if (read(sockets[1], &done, 1) != 1 || done != kDone) _exit(1);
      const std::span<const float> values = fused.values();
      const bool sent = write(sockets[1], values.data(), values.size_bytes()) == ssize_t(values.size_bytes());
      _exit(sent ? 0 : 1);
    } catch (...) {
      _exit(1);
    }
  }
  close(sockets[1]);
  char can = kCannot;
  ASSERT_EQ(read(sockets[0], &can, 1), 1);
  if (can == kReady) {
    const raymeld_import_desc descs[] = {receive_export(sockets[0]), receive_export(sockets[0]),
                                         receive_export(sockets[0])};
    const CallerDevice importer;
    const Context context(context_desc(importer.external()));
    Fusion fusion(context, SharedModel(file_), fusion_desc(subject_));
    const std::vector<float> expected = fuse(fusion, subject_).values;
    fuse_imported(context, fusion, descs);
    const char done = kDone;
    ASSERT_EQ(write(sockets[0], &done, 1), 1);
    std::vector<float> fused(kFusedSize);
    ASSERT_EQ(recv(sockets[0], fused.data(), fused.size() * sizeof(float), MSG_WAITALL),
              ssize_t(fused.size() * sizeof(float)));
    EXPECT_TRUE(same_bits(fused, expected));
  }
  close(sockets[0]);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  if (can == kCannot) GTEST_SKIP() << "the device exports no buffers";
  EXPECT_EQ(status, 0);
}

TEST_F(ImportTest, TheDescriptorIsTakenOverOnSuccessOnly) {
  const Exporter exporter;
  if (!exporter.can_export()) GTEST_SKIP() << "the device exports no buffers";
  const CallerDevice importer;
  const Context context(context_desc(importer.external()));
  const Exported exported(exporter.caller(), 1000);
  const raymeld_import_desc good = exported.desc();
  const auto refused = [&](const Context& on, const raymeld_import_desc& desc, raymeld_result result,
                           const char* text) {
    EXPECT_FAILURE(result, ImportedBuffer(on, desc), text);
    EXPECT_TRUE(is_open(good.fd)) << text;
  };
  const auto with = [&](auto raymeld_import_desc::*member, auto value) {
    raymeld_import_desc desc = good;
    desc.*member = value;
    return desc;
  };
  using Desc = raymeld_import_desc;
  refused(context, with(&Desc::fd, -1), RAYMELD_ERROR_INVALID_ARGUMENT, "fd is -1");
  refused(context, with(&Desc::fd, 12345), RAYMELD_ERROR_DEVICE, "descriptor 12345");
  refused(context, with(&Desc::handle_type, 2u), RAYMELD_ERROR_INVALID_ARGUMENT, "handle_type is 0x2");
  refused(context, with(&Desc::size_bytes, VkDeviceSize{0}), RAYMELD_ERROR_INVALID_ARGUMENT,
          "size_bytes is 0");
  refused(context, with(&Desc::size_bytes, VkDeviceSize{1 << 20}), RAYMELD_ERROR_DEVICE,
          "a buffer of 1048576 bytes");
  refused(context, with(&Desc::offset_bytes, VkDeviceSize{4}), RAYMELD_ERROR_DEVICE, "a multiple of");
  refused(context, with(&Desc::offset_bytes, ~VkDeviceSize{0} / 1024 * 1024), RAYMELD_ERROR_DEVICE,
          "expected");
  raymeld_import_desc part = with(&Desc::dedicated, VkBool32{VK_TRUE});
  part.memory_size_bytes += 4096;
  refused(context, part, RAYMELD_ERROR_DEVICE, "since the memory is dedicated");
  refused(context, with(&Desc::memory_type_index, 31u), RAYMELD_ERROR_DEVICE, "memory of type 31");
  const int file = open(file_.c_str(), O_RDWR | O_CLOEXEC);
  refused(context, with(&Desc::fd, file), RAYMELD_ERROR_DEVICE, "importing memory");
  EXPECT_TRUE(is_open(file));
  close(file);
  raymeld_context_desc without = context_desc(importer.external());
  without.enabled_features &= ~uint32_t(RAYMELD_FEATURE_EXTERNAL_MEMORY_FD);
  refused(Context(without), good, RAYMELD_ERROR_DEVICE, "VK_KHR_external_memory_fd");
  for (const char* function : {"vkCreateBuffer", "vkAllocateMemory", "vkBindBufferMemory"}) {
    interposed().fault = {.function = function, .call = 1, .code = VK_ERROR_OUT_OF_DEVICE_MEMORY};
    refused(context, good, RAYMELD_ERROR_OUT_OF_MEMORY, "importing memory");
  }
  const ImportedBuffer imported(context, good);
  EXPECT_FALSE(is_open(good.fd));
  EXPECT_EQ(imported.info().size_bytes, 4000u);
}

// Drivers for CPUs map any file descriptor, so a file in memory will do.
TEST_F(ImportTest, DmaBufs) {
  const CallerDevice importer;
  const DeviceInfo info = device_info(importer.vk(), importer.external().physical_device, 0);
  if (!info.dma_buf || !info.is_cpu) GTEST_SKIP() << "the device takes no dma_bufs that a test could make";
  const Context context(context_desc(importer.external()));
  Fusion fusion(context, SharedModel(file_), fusion_desc(subject_));
  const std::vector<float> images[] = {lrhs(), hrls(), std::vector<float>(kFusedSize)};
  raymeld_import_desc descs[3];
  float* fused = nullptr;
  constexpr size_t kBytes = 1 << 16;
  for (size_t i = 0; i < 3; ++i) {
    descs[i].fd = memfd_create("dma_buf", MFD_CLOEXEC);
    ASSERT_EQ(ftruncate(descs[i].fd, kBytes), 0);
    void* const mapped = mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_SHARED, descs[i].fd, 0);
    ASSERT_NE(mapped, MAP_FAILED);
    fused = std::ranges::copy(images[i], static_cast<float*>(mapped)).out - images[i].size();
    descs[i].handle_type = VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT;
    descs[i].memory_size_bytes = kBytes;
    descs[i].size_bytes = images[i].size() * sizeof(float);
    ASSERT_LE(descs[i].size_bytes, kBytes);
    if (i < 2) munmap(mapped, kBytes);
  }
  fuse_imported(context, fusion, descs);
  EXPECT_TRUE(same_bits({fused, kFusedSize}, fuse(fusion, subject_).values));
  munmap(fused, kBytes);
}

}  // namespace
}  // namespace raymeld::test
