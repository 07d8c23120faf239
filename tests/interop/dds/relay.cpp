// Hears the readings of a station over Fast DDS, prints them, and sends each back as an answer with the next number.
// Its types are what fastddsgen makes of the IDL that rcgen writes for the station.
//
//     relay DOMAIN FINGERPRINT        (of the operation `answer`; it ends by a signal, or after two minutes)

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <random>
#include <string>
#include <vector>

#include <unistd.h>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include "InteropPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;

// Values as JSON, to be compared by who sent them.

template <class T> void show(T value) { std::cout << +value; }
void show(bool value) { std::cout << (value ? "true" : "false"); }
void show(const std::string &text) { std::cout << '"' << text << '"'; }
void show(const robocomp::Time &time) { std::cout << '[' << time.sec() << ',' << time.nanosec() << ']'; }

template <class... T> void show_all(const T &...values);
void show(const Interop::Point &point) { show_all(point.x(), point.y()); }
void show(const Interop::CountsEntry &entry) { show_all(entry.key(), entry.value()); }
void show(const Interop::Echo &echo);
void show(const Interop::Reading &reading);

template <class T> void show(const std::vector<T> &values) {
    std::cout << '[';
    for (size_t i = 0; i < values.size(); i++) {
        std::cout << (i ? "," : "");
        show(values[i]);
    }
    std::cout << ']';
}

template <class... T> void show_all(const T &...values) {
    const char *between = "[";
    ((std::cout << between, show(values), between = ","), ...);
    std::cout << ']';
}

void show(const Interop::Echo &echo) {
    show_all(echo.name(), echo.quality(), echo.where(), echo.trace(), echo.labels(), echo.heard());
}

void show(const Interop::Reading &reading) {
    show_all(reading.on(), reading.small(), reading.medium(), reading.big(), reading.nearest(), reading.echoes(),
             reading.counts(), reading.raw(), reading.weights());
}

// On this host alone: our component is found at 127.0.0.1, and finds us there.
DomainParticipantQos on_loopback() {
    DomainParticipantQos qos;
    auto udp = std::make_shared<UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    udp->maxInitialPeersRange = 250;  // as many participants of a host are told of us; else four
    udp->sendBufferSize = udp->receiveBufferSize = 1 << 20;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    Locator_t here;
    IPLocator::setIPv4(here, 127, 0, 0, 1);
    qos.wire_protocol().builtin.initialPeersList.push_back(here);
    qos.wire_protocol().builtin.discovery_config.leaseDuration = {2, 0};
    qos.wire_protocol().builtin.discovery_config.leaseDuration_announcementperiod = {1, 0};
    return qos;
}

template <class Qos> Qos reliable(Qos qos) {
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().kind = KEEP_ALL_HISTORY_QOS;
    qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return qos;
}

int main(int count, char **arguments) {
    if (count != 3) {
        std::cerr << "usage: relay DOMAIN FINGERPRINT\n";
        return 2;
    }
    alarm(120);
    auto domain = std::stoul(arguments[1]);
    auto fingerprint = std::stoull(arguments[2], nullptr, 16);
    std::random_device random;
    uint64_t source = uint64_t(random()) << 32 | random(), sent = 0;
    std::cout.precision(17);

    auto *participant = DomainParticipantFactory::get_instance()->create_participant(domain, on_loopback());
    TypeSupport readings(new Interop::ReadingsReadingPublicationPubSubType());
    TypeSupport answers(new Interop::AnswersAnswerPublicationPubSubType());
    readings.register_type(participant);
    answers.register_type(participant);
    auto *heard = participant->create_topic("rc/station/Readings/reading", readings.get_type_name(), TOPIC_QOS_DEFAULT);
    auto *told = participant->create_topic("rc/relay/Answers/answer", answers.get_type_name(), TOPIC_QOS_DEFAULT);
    auto *reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)
                       ->create_datareader(heard, reliable(DATAREADER_QOS_DEFAULT));
    auto *writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)
                       ->create_datawriter(told, reliable(DATAWRITER_QOS_DEFAULT));

    while (true) {
        Interop::ReadingsReadingPublication reading;
        SampleInfo info;
        reader->wait_for_unread_message({1, 0});
        while (reader->take_next_sample(&reading, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            show_all(reading.number(), reading.header().sequence(), reading.reading());
            std::cout << std::endl;

            Interop::AnswersAnswerPublication answer;
            answer.header().version(1);
            answer.header().fingerprint(fingerprint);
            answer.header().source(source);
            answer.header().sequence(++sent);
            answer.header().stamp(std::chrono::system_clock::now().time_since_epoch() / std::chrono::nanoseconds(1));
            answer.reading(reading.reading());
            answer.number(reading.number() + 1);
            writer->write(&answer);
        }
    }
}
