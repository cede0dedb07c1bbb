#include "tribode/record/csv.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/mat.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/zip.hpp"
#include "unit/record/damage.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <hdf5.h>

namespace tribode {
namespace {

Table small_record() {
    Table table;
    table.add("t_s", "s", {0, 0.5, 1, 1.5});
    table.add("u_V", "V", {1, 2, -3, 1e-9});
    table.add("q_m", "m", {0.1, 0.2, 0.3, 0.4});
    return table;
}

const RecordOptions mapped = RecordOptions::parse("t=t_s,u=u_V", "u=35.15");
const std::vector<std::string> wanted = {"t", "u", "y"};

std::string problem(const std::string& bytes, const RecordOptions& options = {},
                    const std::vector<std::string>& names = wanted) {
    return problem_of([&] { record_from_bytes(bytes, "x", options, names); });
}

TEST(RecordFile, IsTheSameFromEveryFormatWhateverItsName) {
    const TemporaryFolder folder;
    for (const char* name : {"x.csv", "x.csv.gz", "x.mat", "x.h5", "x.hdf5"})
        write_record(folder / name, small_record());
    EXPECT_TRUE(is_gzip(read_file(folder / "x.csv.gz")));
    EXPECT_TRUE(is_mat5(read_file(folder / "x.mat")));
    EXPECT_TRUE(is_hdf5(read_file(folder / "x.h5")));
    EXPECT_EQ(read_file(folder / "x.hdf5"), read_file(folder / "x.h5"));
    folder.write("x.mat.gz", gzip(read_file(folder / "x.mat")));
    folder.write("x.h5.gz", gzip(read_file(folder / "x.h5")));
    folder.write("hdf5 as.csv", read_file(folder / "x.h5"));
    folder.write("csv as.mat", read_file(folder / "x.csv"));

    for (const char* name :
         {"x.csv", "x.csv.gz", "x.mat", "x.h5", "x.mat.gz", "x.h5.gz", "hdf5 as.csv", "csv as.mat"}) {
        const Record record = read_record(folder / name, mapped, wanted);
        EXPECT_EQ(record.table.source, folder / name);
        EXPECT_EQ(record.table.names(), (std::vector<std::string>{"t", "u"})) << name;
        EXPECT_EQ(record.table["t"].values, small_record()["t_s"].values) << name;
        for (std::size_t row = 0; row < 4; ++row) {
            EXPECT_EQ(record.table["u"].values[row], 35.15 * small_record()["u_V"].values[row]) << name;
        }
        ASSERT_TRUE(record.time);
        EXPECT_EQ(record.time->sample_time, 0.5);

        const Record all = read_record(folder / name);
        EXPECT_EQ(all.table.names(), small_record().names()) << name;
        EXPECT_FALSE(all.time) << name << ": there is no column t";
    }
}

TEST(RecordFile, NamesMayBeExchangedAndOneMayServeTwice) {
    const std::string text = "t,u,y\n0,1,10\n1,2,20\n";
    const Table exchanged = record_from_bytes(text, "x", RecordOptions::parse("u=y,y=u", ""), wanted).table;
    EXPECT_EQ(exchanged["y"].values, (std::vector<double>{1, 2}));
    EXPECT_EQ(exchanged["u"].values, (std::vector<double>{10, 20}));
    const Table twice = record_from_bytes(text, "x", RecordOptions::parse("u=y,y=y", ""), wanted).table;
    EXPECT_EQ(twice["y"].values, twice["u"].values);
}

TEST(RecordFile, OfACsvFileOnlyWhatIsAskedForIsRead) {
    const std::string text = "t_s,u_V,state\n0,1,idle\n0.5,2,moves\n";
    EXPECT_EQ(record_from_bytes(text, "x", mapped, wanted).table.names(), (std::vector<std::string>{"t", "u"}));
    EXPECT_EQ(problem(text), "input: x:2: column state is \"idle\", must be a number");
    // Without other names the file is the record, and the caller refuses what it does not know.
    EXPECT_EQ(record_from_bytes("t,u,excc\n0,1,2\n", "x", {}, wanted).table.names(),
              (std::vector<std::string>{"t", "u", "excc"}));
}

TEST(RecordFile, WhatElseAMatFileHoldsIsPassedOverUnlessItIsAskedFor) {
    Table table;
    table.add("t", "", {0, 1, 2});
    table.add("u", "", {0, 1, 2});
    std::string bytes = to_mat(table);
    for (const auto& [name, values] : {std::pair{"Ts", std::vector<double>{1}}, {"y", {1, 2}}}) {
        Table other;
        other.add(name, "", values);
        bytes += to_mat(other).substr(128);
    }
    EXPECT_EQ(record_from_bytes(bytes, "x", {}, {"t", "u"}).table.names(), (std::vector<std::string>{"t", "u"}));
    EXPECT_EQ(record_from_bytes(bytes, "x").table.names(), (std::vector<std::string>{"t", "u"}));
    EXPECT_EQ(problem(bytes), "input: x: y has 2 values, must have 3 like t");
    EXPECT_EQ(problem(bytes, RecordOptions::parse("u=Ts", ""), {"t", "u"}),
              "input: x: t has 3 values, must have 1 like Ts");
}

TEST(RecordFile, EachMistakeIsOneSentence) {
    const std::string text = to_csv(small_record());
    EXPECT_EQ(problem(text), "input: x: there is no column t (did you mean \"t_s\"?)");
    EXPECT_EQ(problem(text, RecordOptions::parse("t=t_s,u=u_N", "")),
              "input: x: there is no column u_N (did you mean \"u_V\"?)");
    EXPECT_EQ(problem(text, RecordOptions::parse("t=t_s,u=u_V", "y=2")),
              "input: x: there is no column y (known: t, u)");
    Table table = small_record();
    table.columns[1].values[2] = std::nan("");
    EXPECT_EQ(problem(to_csv(table), mapped), "input: x:4: column u_V is nan, must be a finite number");
    EXPECT_EQ(problem(to_mat(table), mapped), "input: x: row 3: column u is nan, must be a finite number");
    table.columns[0].values[2] = 0.5;
    table.columns[1].values[2] = 0;
    EXPECT_EQ(problem(to_csv(table), mapped), "input: x:4: t = 0.5 s after 0.5 s, time must increase from row to row");
    EXPECT_EQ(problem(std::string("ELF\0\0\0", 6)).substr(0, 45), "input: x: is not a record that can be read, m");
    Table empty;
    empty.add("t", "", {});
    EXPECT_EQ(problem(to_mat(empty)), "input: x: there are no rows, must be one at least");
    EXPECT_EQ(problem(to_mat(Table{}), {}, {}), "input: x: there is no vector of numbers");
}

TEST(RecordOptionsTest, SaysWhatIsWrongWithThePairs) {
    const auto of = [](const char* columns, const char* scale) {
        return problem_of([&] { RecordOptions::parse(columns, scale); });
    };
    EXPECT_EQ(of("t=t_s,u=u_V", "u=35.15,y=-1e-3"), "none: ");
    EXPECT_EQ(of("t=t_s,u", ""), "input: --columns t=t_s,u: \"u\" must be name=value");
    EXPECT_EQ(of("t=", ""), "input: --columns t=: \"t=\" must be name=value");
    EXPECT_EQ(of("t=a,t=b", ""), "input: --columns t=a,t=b: t stands twice");
    EXPECT_EQ(of("", "u=inf"), "input: --scale u=inf: must be a number");

    const Json options{{"columns", {{"t", "t_s"}}}, {"scale", {{"t", 1e-3}}}};
    FieldReader fields(options, "f");
    const RecordOptions read = RecordOptions::read(fields);
    fields.finish();
    EXPECT_EQ(read.columns.at("t"), "t_s");
    EXPECT_EQ(read.scale.at("t"), 1e-3);
    const auto table = [](const Json& json) {
        return problem_of([&] {
            FieldReader reader(json, "f");
            RecordOptions::read(reader);
        });
    };
    EXPECT_EQ(table({{"columns", {{"t", 3}}}}), "input: f: columns.t must be a text, the name in the file");
    EXPECT_EQ(table({{"scale", {{"t", "3"}}}}), "input: f: scale.t must be a finite number");
    EXPECT_EQ(table({{"scale", "u=3"}}), "input: f: scale must be a table {name = value}");
}

TEST(TimeGrid, CountsWhatIsMissingAndMeasuresTheJitter) {
    Table table;
    std::vector<double> t;
    for (int k = 0; k < 1000; ++k) {
        if (k == 300 || (k >= 500 && k < 510)) continue;
        // Jitter of one microsecond up and down: its rms and its greatest value are the same.
        t.push_back(7 + k * 5e-4 + (k % 2 ? 1e-6 : -1e-6));
    }
    table.add("t", "s", t);
    const TimeGrid grid = time_grid(table);
    EXPECT_EQ(grid.dropped, 11u);
    ASSERT_EQ(grid.gaps.size(), 2u);
    EXPECT_EQ(grid.gaps[0].row, 300u);
    EXPECT_EQ(grid.gaps[1].row, 499u);
    EXPECT_EQ(grid.gaps[1].missing, 10u);
    // The line's slope takes 1e-6 s over about 1000 samples at most, and so do the residuals.
    EXPECT_NEAR(grid.sample_time, 5e-4, 1e-9);
    EXPECT_NEAR(grid.jitter_rms, 1e-6, 1e-8);
    EXPECT_NEAR(grid.jitter_max, 1e-6, 1e-8);
}

TEST(TimeGrid, AnEvenRecordHasRoundingAlone) {
    Table table;
    std::vector<double> t;
    for (int k = 0; k < 20000; ++k) t.push_back(100 + k * 1e-3);
    table.add("t", "s", t);
    const TimeGrid grid = time_grid(table);
    EXPECT_EQ(grid.dropped, 0u);
    // Instants near 100 s are rounded to 1.4e-14 s.
    EXPECT_LT(grid.jitter_max, 3e-14);
    EXPECT_NEAR(grid.sample_time, 1e-3, 1e-16);

    Table one;
    one.add("t", "s", {3});
    EXPECT_EQ(time_grid(one).sample_time, 0);
}

TEST(TimeGrid, ARunRefusesAnUnevenRecordWithWhatIsWrongInAll) {
    const auto refusal = [](std::vector<double> t) {
        Table table;
        table.add("t", "s", std::move(t));
        return problem_of([&] { require_uniform_time(table, 0.5); });
    };
    EXPECT_EQ(refusal({0, 0.5, 1, 2.5, 3, 3.5, 4.5}),
              "input: row 4: t = 2.5 s, expected 1.5 s (sample time 0.5 s): the "
              "record has a gap in time (3 samples missing in 2 gaps in all)");
    EXPECT_EQ(refusal({0, 0.25, 0.5}), "input: row 2: t = 0.25 s, expected 0.5 s (sample time 0.5 s): the record has "
                                       "another sample time (0.25 s) or is not uniform (jitter 0 s rms)");
}

// ---- HDF5 --------------------------------------------------------------------------------------------------------

// An HDF5 file made with the library, and what else MATLAB and others put into one.
class Hdf5File {
  public:
    explicit Hdf5File(const std::filesystem::path& path, hsize_t head = 0) {
        const hid_t creation = H5Pcreate(H5P_FILE_CREATE);
        H5Pset_userblock(creation, head);
        file_ = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, H5P_DEFAULT);
        H5Pclose(creation);
    }
    ~Hdf5File() { H5Fclose(file_); }

    hid_t group(const char* name) const { return H5Gcreate2(file_, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT); }
    hid_t root() const { return file_; }

    static hid_t add(hid_t parent, const char* name, hid_t type, std::vector<hsize_t> shape, const void* data) {
        const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
        const hid_t set = H5Dcreate2(parent, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
        H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data);
        H5Sclose(space);
        return set;
    }

    static void matlab_class(hid_t object, const char* name) {
        const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
        H5Tset_size(type, std::string(name).size());
        const hid_t attribute = H5Acreate2(object, "MATLAB_class", type, space, H5P_DEFAULT, H5P_DEFAULT);
        H5Awrite(attribute, type, name);
        H5Aclose(attribute);
        H5Sclose(space);
        H5Tclose(type);
    }

  private:
    hid_t file_;
};

const double four[] = {0, 1, 2, 3};
const std::int32_t whole[] = {0, 1, 2, 3};

TEST(RecordFile, ReadsMatlabFilesOfVersion73) {
    const TemporaryFolder folder;
    {
        const Hdf5File file(folder / "x.mat", 512);
        const auto add = [&](const char* name, hid_t type, std::vector<hsize_t> shape, const void* data,
                             const char* kind) {
            const hid_t set = Hdf5File::add(file.root(), name, type, std::move(shape), data);
            Hdf5File::matlab_class(set, kind);
            H5Dclose(set);
        };
        add("t", H5T_NATIVE_DOUBLE, {1, 4}, four, "double");
        add("u", H5T_NATIVE_DOUBLE, {4, 1}, four, "double");
        add("counts", H5T_NATIVE_INT32, {1, 4}, whole, "int32");
        add("matrix", H5T_NATIVE_DOUBLE, {2, 2}, four, "double");
        const hid_t pair = H5Tcreate(H5T_COMPOUND, 2 * sizeof(double));
        H5Tinsert(pair, "real", 0, H5T_NATIVE_DOUBLE);
        H5Tinsert(pair, "imag", sizeof(double), H5T_NATIVE_DOUBLE);
        add("z", pair, {1, 2}, four, "double");
        H5Tclose(pair);
        const hid_t group = file.group("s");
        Hdf5File::matlab_class(group, "struct");
        H5Dclose(Hdf5File::add(group, "t", H5T_NATIVE_DOUBLE, {1, 4}, four));
        H5Gclose(group);
        H5Gclose(file.group("#refs#"));
    }
    EXPECT_EQ(read_record(folder / "x.mat", {}, wanted).table.names(), (std::vector<std::string>{"t", "u"}));
    const auto asked_for = [&](const char* name) {
        const auto text = problem_of([&] { read_record(folder / "x.mat", RecordOptions::parse(name, ""), wanted); });
        return text.substr(text.find("x.mat: ") + 7);
    };
    const std::string end = "; vectors in the file: t, u";
    EXPECT_EQ(asked_for("u=counts"), "counts is of class int32, must be one of doubles" + end);
    EXPECT_EQ(asked_for("u=matrix"), "matrix is a matrix (2 x 2), must be a vector" + end);
    EXPECT_EQ(asked_for("u=z"), "z is complex or a record, must be real" + end);
    EXPECT_EQ(asked_for("u=s"), "s is a struct, must be an array of doubles" + end);
}

TEST(RecordFile, TheNameOfTheOnlyGroupMayBeLeftOut) {
    const TemporaryFolder folder;
    {
        const Hdf5File file(folder / "x.h5");
        const hid_t group = file.group("run");
        for (const char* name : {"t", "u"}) {
            H5Dclose(Hdf5File::add(group, name, H5T_NATIVE_INT32, {4}, whole));
        }
        H5Gclose(group);
    }
    EXPECT_EQ(read_record(folder / "x.h5", {}, wanted).table["u"].values, (std::vector<double>{0, 1, 2, 3}));

    NamedTable a{"a", {}}, b{"b", {}};
    a.table.add("t", "s", {0, 1});
    b.table.add("t", "s", {0, 2});
    write_hdf5(folder / "two.h5", {a, b});
    EXPECT_EQ(read_record(folder / "two.h5", RecordOptions::parse("t=b/t", ""), wanted).table["t"].values,
              (std::vector<double>{0, 2}));
    EXPECT_NE(problem_of([&] { read_record(folder / "two.h5", {}, wanted); }).find("there is no column t"),
              std::string::npos);
}

// Of a hundred files damaged like these the library crashes on two or three (libhdf5 1.10.8: seeds 14 and 34).
TEST(RecordFile, DamagedHdf5FilesGiveOneSentence) {
    const std::string bytes = to_hdf5({{"", small_record()}});
    for (std::uint32_t seed = 0; seed < 40; ++seed) {
        const std::string text = problem(damaged(bytes, seed), {}, {});
        ASSERT_TRUE(text.starts_with("input: x: ") || text == "none: ") << text << ", seed " << seed;
        ASSERT_EQ(text.find('\n'), std::string::npos);
    }
}

// A file that a stranger has made reads no other file: not its numbers, and not what the library makes of them.
// Makes an external link, also where the reader has taken that kind of link away.
void link_to_another_file(hid_t parent, const char* name, const std::string& file, const std::string& object) {
    H5L_class_t kind{};
    kind.version = H5L_LINK_CLASS_T_VERS;
    kind.id = H5L_TYPE_EXTERNAL;
    kind.trav_func = [](const char*, hid_t, const void*, size_t, hid_t, hid_t) -> hid_t { return -1; };
    ASSERT_GE(H5Lregister(&kind), 0);
    const std::string value = std::string(1, '\0') + file + '\0' + object + '\0';
    ASSERT_GE(H5Lcreate_ud(parent, name, H5L_TYPE_EXTERNAL, value.data(), value.size(), H5P_DEFAULT, H5P_DEFAULT), 0);
    H5Lunregister(H5L_TYPE_EXTERNAL);
}

TEST(RecordFile, AnHdf5FileReachesNoOtherFile) {
    const TemporaryFolder folder;
    const std::string secret = folder.write("secret.txt", std::string(32, 'S')).string();
    write_hdf5(folder / "other.h5", {{"", small_record()}});
    {
        const Hdf5File file(folder / "x.h5");
        H5Dclose(Hdf5File::add(file.root(), "t", H5T_NATIVE_DOUBLE, {4}, four));
        const hsize_t length = 4;
        const hid_t space = H5Screate_simple(1, &length, nullptr);
        const auto make = [&](hid_t parent, const char* name, hid_t creation) {
            H5Dclose(H5Dcreate2(parent, name, H5T_NATIVE_DOUBLE, space, H5P_DEFAULT, creation, H5P_DEFAULT));
        };
        const hid_t external = H5Pcreate(H5P_DATASET_CREATE), made_of_others = H5Pcreate(H5P_DATASET_CREATE);
        H5Pset_external(external, secret.c_str(), 0, 32);
        H5Pset_virtual(made_of_others, space, (folder / "other.h5").c_str(), "u_V", space);
        const hid_t group = file.group("g");
        for (const hid_t parent : {file.root(), group}) {
            make(parent, "u", external);
            make(parent, "v", made_of_others);
            link_to_another_file(parent, "w", (folder / "other.h5").string(), "u_V");
        }
        H5Lcreate_soft("/w", file.root(), "soft", H5P_DEFAULT, H5P_DEFAULT); // a link to the link
        H5Gclose(group);
        H5Pclose(external);
        H5Pclose(made_of_others);
        H5Sclose(space);
    }
    const std::string elsewhere = "has its numbers in another file, which is not read",
                      link = "is a link to another file, which is not followed";
    for (const auto& [name, reason] : std::vector<std::pair<std::string, std::string>>{
             {"u", elsewhere}, {"v", elsewhere}, {"w", link}, {"g/u", elsewhere}, {"g/v", elsewhere}, {"g/w", link}}) {
        const auto text = problem_of([&] { read_record(folder / "x.h5", RecordOptions::parse("u=" + name, "")); });
        EXPECT_NE(text.find(name + " " + reason + "; vectors in the file: t"), std::string::npos) << text;
    }
    EXPECT_NE(
        problem_of([&] { read_record(folder / "x.h5", RecordOptions::parse("u=soft", "")); }).find("no column soft"),
        std::string::npos);
    // What is the file's own is read as before.
    EXPECT_EQ(read_record(folder / "x.h5", RecordOptions::parse("t=t", "")).table["t"].values,
              (std::vector<double>{0, 1, 2, 3}));
}

TEST(RecordFile, WhatUnpacksToFarMoreThanItsSizeIsRefused) {
    // 100 MiB of one letter become 100 KiB, packed twice a few hundred bytes.
    const std::string packed = gzip(std::string(std::size_t{100} << 20, '1'));
    EXPECT_EQ(problem(packed), "input: x: unpacks to more than " +
                                   std::to_string(max_unpacked_of(packed.size()) >> 20) +
                                   " MiB, which is more than a file of this size may; it is not read");
    EXPECT_LT(max_unpacked_of(packed.size()), std::size_t{100} << 20);
    EXPECT_EQ(max_unpacked_of(0), std::size_t{64} << 20);
    EXPECT_EQ(max_unpacked_of(std::size_t{1} << 40), std::size_t{4} << 30);
    // A record of which all but the time stands still.
    std::string text = "t,u,y\n";
    for (int k = 0; k < 100'000; ++k) text += std::to_string(k) + ",0,0\n";
    EXPECT_EQ(problem(gzip(text)), "none: ");
}

TEST(RecordFile, AHeaderOfTooManyColumnsIsRefused) {
    std::string text = "t";
    for (int i = 0; i < 60'000; ++i) text += ",c" + std::to_string(i);
    EXPECT_EQ(problem(text + "\n"), "input: x:1: there are more than 10000 columns, must be fewer");
}

} // namespace
} // namespace tribode
