// A scanner in C++, by libOpenIGTLink: sends IMAGEs of 16 bits and prints the STATUS that answers each.
// Usage: image_sender PORT COLUMNS ROWS LATERAL_MM DEPTH_MM COUNT FORCE_UN...  (the last force stays)
// Pixel 0 is the force, as the rule of small_monitor.py reads it; pixel 1 counts.

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <iostream>

#include "igtlClientSocket.h"
#include "igtlImageMessage.h"
#include "igtlMessageHeader.h"
#include "igtlOSUtil.h"
#include "igtlStatusMessage.h"
#include "igtlStringMessage.h"
#include "igtl_util.h"

int main(int argc, char* argv[]) {
  igtl::ClientSocket::Pointer link = igtl::ClientSocket::New();
  if (argc < 8 || link->ConnectToServer("127.0.0.1", atoi(argv[1])) != 0) return 2;
  int size[] = {atoi(argv[2]), atoi(argv[3]), 1}, offset[] = {0, 0, 0}, count = atoi(argv[6]);
  float spacing[] = {(float)atof(argv[4]), (float)atof(argv[5]), 1.0f};

  for (int number = 0; number < count; number++) {
    igtl::ImageMessage::Pointer image = igtl::ImageMessage::New();
    image->SetDimensions(size);
    image->SetSpacing(spacing);
    image->SetScalarType(igtl::ImageMessage::TYPE_UINT16);
    image->SetEndian(igtl_is_little_endian() ? igtl::ImageMessage::ENDIAN_LITTLE : igtl::ImageMessage::ENDIAN_BIG);
    image->SetDeviceName("CppScanner");
    image->SetSubVolume(size, offset);
    image->AllocateScalars();
    std::memset(image->GetScalarPointer(), 0, image->GetImageSize());
    uint16_t* pixels = static_cast<uint16_t*>(image->GetScalarPointer());
    pixels[0] = atoi(argv[number + 7 < argc ? number + 7 : argc - 1]);
    pixels[1] = number + 1;
    igtl::TimeStamp::Pointer now = igtl::TimeStamp::New();
    now->GetTime();
    image->SetTimeStamp(now);
    image->Pack();
    if (!link->Send(image->GetPackPointer(), image->GetPackSize())) return 3;

    int code = -1, sub_code = -1;
    for (bool answered = false; !answered;) {  // the STATUS before the STRING is this frame's
      igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
      header->InitPack();
      if (link->Receive(header->GetPackPointer(), header->GetPackSize()) != header->GetPackSize()) return 4;
      header->Unpack();
      if (strcmp(header->GetDeviceType(), "STATUS") == 0) {
        igtl::StatusMessage::Pointer status = igtl::StatusMessage::New();
        status->SetMessageHeader(header);
        status->AllocatePack();
        link->Receive(status->GetPackBodyPointer(), status->GetPackBodySize());
        if (!(status->Unpack(1) & igtl::MessageHeader::UNPACK_BODY)) return 5;  // its CRC is wrong
        code = status->GetCode();
        sub_code = status->GetSubCode();
      } else if (strcmp(header->GetDeviceName(), "ForceReading") == 0 &&
                 strcmp(header->GetDeviceType(), "STRING") == 0) {
        igtl::StringMessage::Pointer text = igtl::StringMessage::New();
        text->SetMessageHeader(header);
        text->AllocatePack();
        link->Receive(text->GetPackBodyPointer(), text->GetPackBodySize());
        if (!(text->Unpack(1) & igtl::MessageHeader::UNPACK_BODY)) return 6;
        std::cout << number + 1 << " " << code << " " << sub_code << " " << text->GetString() << std::endl;
        answered = true;
      } else {
        link->Skip(header->GetBodySizeToRead(), 0);
      }
    }
    igtl::Sleep(10);
  }
  link->CloseSocket();
  return 0;
}
