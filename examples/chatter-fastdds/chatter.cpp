// `chatter publish` says a greeting twice a second, `chatter subscribe` prints every one that arrives, until SIGTERM or SIGINT.
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <iostream>
#include <string>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

namespace {

volatile std::sig_atomic_t stopping = 0;
constexpr std::uint32_t kLongest = 256;

// A text as it is, of at most kLongest bytes.
class TextType : public TopicDataType {
 public:
  TextType() {
    setName("chatter::Text");
    m_typeSize = kLongest;
    m_isGetKeyDefined = false;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const auto& text = *static_cast<std::string*>(data);
    payload->length = static_cast<std::uint32_t>(text.size());
    std::memcpy(payload->data, text.data(), text.size());
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    static_cast<std::string*>(data)->assign(reinterpret_cast<char*>(payload->data), payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<std::string*>(data)->size()); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

void publish(DomainParticipant* participant, Topic* topic) {
  char host[64] = {};
  gethostname(host, sizeof host - 1);
  DataWriter* writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
  for (int number = 1; !stopping; ++number, usleep(500000)) {
    std::string text = "hello from " + std::string(host) + " #" + std::to_string(number);
    writer->write(&text);
    std::cout << "said: " << text << std::endl;
  }
}

void subscribe(DomainParticipant* participant, Topic* topic) {
  DataReader* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, DATAREADER_QOS_DEFAULT);
  for (; !stopping; usleep(50000)) {
    std::string text;
    SampleInfo info;
    while (reader->take_next_sample(&text, &info) == ReturnCode_t::RETCODE_OK) {
      if (info.valid_data) std::cout << "heard: " << text << std::endl;
    }
  }
}

}  // namespace

int main(int count, char** words) {
  std::signal(SIGTERM, [](int) { stopping = 1; });
  std::signal(SIGINT, [](int) { stopping = 1; });
  auto* factory = DomainParticipantFactory::get_instance();
  DomainParticipant* participant = factory->create_participant(0, PARTICIPANT_QOS_DEFAULT);
  if (participant == nullptr) return 1;
  TypeSupport type(new TextType);
  type.register_type(participant);
  Topic* topic = participant->create_topic("chatter", type.get_type_name(), TOPIC_QOS_DEFAULT);
  const std::string what = count > 1 ? words[1] : "";
  if (what == "publish") publish(participant, topic);
  if (what == "subscribe") subscribe(participant, topic);
  participant->delete_contained_entities();
  factory->delete_participant(participant);
  return what == "publish" || what == "subscribe" ? 0 : 2;
}
