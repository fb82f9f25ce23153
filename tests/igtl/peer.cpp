// A client on the OpenIGTLink library of Debian (libopenigtlink-dev 1.11, protocol version 2), CRC checked: prints each
// message as a line, and sends each line of its standard input, "CMD_1 <Command .../>", as a STRING.
#include <igtlClientSocket.h>
#include <igtlImageMessage.h>
#include <igtlMessageHeader.h>
#include <igtlPointMessage.h>
#include <igtlPositionMessage.h>
#include <igtlStatusMessage.h>
#include <igtlStringMessage.h>
#include <igtlTransformMessage.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <string>
#include <thread>

namespace {

void print(const igtl::Matrix4x4& matrix)
{
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column)
      std::printf(" %.6g", matrix[row][column]);
}

template <class Message>
typename Message::Pointer receive(igtl::ClientSocket* socket, igtl::MessageHeader* header)
{
  typename Message::Pointer message = Message::New();
  message->SetMessageHeader(header);
  message->AllocatePack();
  socket->Receive(message->GetPackBodyPointer(), message->GetPackBodySize());
  // 1: check the CRC.
  if (!(message->Unpack(1) & igtl::MessageHeader::UNPACK_BODY)) {
    std::printf("WRONG CRC %s\n", header->GetDeviceType());
    std::exit(1);
  }
  return message;
}

void send_lines(igtl::ClientSocket* socket)
{
  std::string line;
  while (std::getline(std::cin, line)) {
    const size_t space = line.find(' ');
    igtl::StringMessage::Pointer message = igtl::StringMessage::New();
    message->SetDeviceName(line.substr(0, space).c_str());
    std::string text = line.substr(space + 1);
    message->SetString(text);
    message->Pack();
    socket->Send(message->GetPackPointer(), message->GetPackSize());
  }
}

}  // namespace

int main(int, char** argv)
{
  igtl::ClientSocket::Pointer socket = igtl::ClientSocket::New();
  if (socket->ConnectToServer("127.0.0.1", std::atoi(argv[1])) != 0) return 2;
  std::thread(send_lines, socket.GetPointer()).detach();
  for (;;) {
    igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
    header->InitPack();
    if (socket->Receive(header->GetPackPointer(), header->GetPackSize()) != header->GetPackSize()) return 0;
    header->Unpack();
    const std::string kind = header->GetDeviceType();
    std::printf("%s %s", kind.c_str(), header->GetDeviceName());
    if (kind == "TRANSFORM") {
      igtl::Matrix4x4 matrix;
      receive<igtl::TransformMessage>(socket, header)->GetMatrix(matrix);
      print(matrix);
    } else if (kind == "IMAGE") {
      igtl::ImageMessage::Pointer image = receive<igtl::ImageMessage>(socket, header);
      int size[3];
      float spacing[3];
      igtl::Matrix4x4 matrix;
      image->GetDimensions(size);
      image->GetSpacing(spacing);
      image->GetMatrix(matrix);
      unsigned long sum = 0;
      const unsigned char* pixels = static_cast<const unsigned char*>(image->GetScalarPointer());
      for (int each = 0; each < image->GetImageSize(); ++each) sum += pixels[each];
      std::printf(" %d %d %d %d %lu %.6g %.6g %.6g", size[0], size[1], size[2], image->GetScalarType(), sum, spacing[0],
                  spacing[1], spacing[2]);
      print(matrix);
    } else if (kind == "POINT") {
      igtl::PointMessage::Pointer points = receive<igtl::PointMessage>(socket, header);
      for (int each = 0; each < points->GetNumberOfPointElement(); ++each) {
        igtl::PointElement::Pointer point;
        points->GetPointElement(each, point);
        float place[3];
        point->GetPosition(place);
        std::printf(" %s %s %.6g %.6g %.6g", point->GetName(), point->GetGroupName(), place[0], place[1], place[2]);
      }
    } else if (kind == "POSITION") {
      igtl::PositionMessage::Pointer position = receive<igtl::PositionMessage>(socket, header);
      float place[3], turned[4];
      position->GetPosition(place);
      position->GetQuaternion(turned);
      std::printf(" %.6g %.6g %.6g %.6g %.6g %.6g %.6g", place[0], place[1], place[2], turned[0], turned[1], turned[2],
                  turned[3]);
    } else if (kind == "STRING") {
      std::printf(" %s", receive<igtl::StringMessage>(socket, header)->GetString());
    } else if (kind == "STATUS") {
      igtl::StatusMessage::Pointer status = receive<igtl::StatusMessage>(socket, header);
      std::printf(" %d %s %s", status->GetCode(), status->GetErrorName(), status->GetStatusString());
    } else {
      std::printf(" unknown");
      socket->Skip(header->GetBodySizeToRead(), 0);
    }
    std::printf("\n");
    std::fflush(stdout);
  }
}
